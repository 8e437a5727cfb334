//! Columns that mark a row of either table: `session` and `exclude`.

/// What the rows of one mounting and power-up share.
pub(super) const SESSION: &str = "session";
/// `yes` where a row is kept and not used.
pub(super) const EXCLUDE: &str = "exclude";

/// Which of the marks a table has.
pub(super) struct Marks {
    session: bool,
    exclude: bool,
}

impl Marks {
    /// Those that some of the rows, given with their session and whether they are excluded, bear.
    pub(super) fn of<'r>(rows: impl Iterator<Item = (Option<&'r str>, bool)>) -> Self {
        let none = Self {
            session: false,
            exclude: false,
        };
        rows.fold(none, |marks, (session, exclude)| Self {
            session: marks.session || session.is_some(),
            exclude: marks.exclude || exclude,
        })
    }

    /// Their columns.
    pub(super) fn columns(&self) -> impl Iterator<Item = &'static str> {
        let session = self.session.then_some(SESSION);
        session.into_iter().chain(self.exclude.then_some(EXCLUDE))
    }

    /// The cells of a row in these columns.
    pub(super) fn cells(
        &self,
        session: Option<&str>,
        exclude: bool,
    ) -> impl Iterator<Item = String> {
        let word = if exclude { "yes" } else { "" };
        let session = self.session.then(|| session.unwrap_or_default().to_owned());
        session
            .into_iter()
            .chain(self.exclude.then(|| word.to_owned()))
    }
}
