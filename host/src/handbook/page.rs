//! A page of headings, paragraphs and entries, for the terminal and as Markdown.

use std::fmt::Write as _;

/// A page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Page {
    /// Its title.
    pub title: String,
    /// Its parts in order.
    pub parts: Vec<Part>,
}

/// A part of a page.
#[derive(Clone, Debug, PartialEq)]
pub enum Part {
    /// A heading.
    Heading(String),
    /// A paragraph.
    Text(String),
    /// Lines as they are.
    Lines(String),
    /// Names with what they are; the heads of the columns of a table of them.
    Entries([&'static str; 4], Vec<Entry>),
}

/// A name and what it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// The name.
    pub name: String,
    /// Its unit, kind or the like.
    pub facts: String,
    /// What it is, in a sentence.
    pub text: String,
    /// An example; empty without one.
    pub example: String,
}

impl Page {
    /// For a terminal of so many columns.
    pub fn text(&self, columns: usize) -> String {
        let mut text = format!("{}\n", self.title);
        for part in &self.parts {
            match part {
                Part::Heading(heading) => {
                    let _ = writeln!(text, "\n{}", heading.to_uppercase());
                }
                Part::Text(paragraph) => {
                    let _ = writeln!(text, "\n{}", wrapped(paragraph, columns, ""));
                }
                Part::Lines(lines) => {
                    text.push('\n');
                    lines.lines().for_each(|line| {
                        let _ = writeln!(text, "    {line}");
                    });
                }
                Part::Entries(_, entries) => {
                    text.push('\n');
                    for entry in entries {
                        let _ = writeln!(text, "  {}  {}", entry.name, entry.facts);
                        let example = match entry.example.as_str() {
                            "" => String::new(),
                            example => format!(" (as {example})"),
                        };
                        let line = format!("{}{example}", entry.text);
                        let _ = writeln!(text, "{}", wrapped(&line, columns, "      "));
                    }
                }
            }
        }
        text
    }

    /// As Markdown.
    pub fn markdown(&self) -> String {
        let mut text = format!("# {}\n", self.title);
        for part in &self.parts {
            let _ = match part {
                Part::Heading(heading) => writeln!(text, "\n## {heading}"),
                Part::Text(paragraph) => writeln!(text, "\n{paragraph}"),
                Part::Lines(lines) => writeln!(text, "\n```text\n{lines}\n```"),
                Part::Entries(heads, entries) => writeln!(text, "\n{}", rows(heads, entries)),
            };
        }
        text
    }
}

fn rows(heads: &[&str; 4], entries: &[Entry]) -> String {
    let cell = |text: &str| text.replace('|', "\\|");
    let code = |text: &str| match text {
        "" => String::new(),
        text => format!("`{}`", cell(text)),
    };
    // A column that no entry fills is left out.
    let columns = |entry: &Entry| {
        [
            code(&entry.name),
            cell(&entry.facts),
            cell(&entry.text),
            code(&entry.example),
        ]
    };
    let all: Vec<[String; 4]> = entries.iter().map(columns).collect();
    let filled = |column: &usize| all.iter().any(|row| !row[*column].is_empty());
    let shown: Vec<usize> = (0..4).filter(filled).collect();
    let line = |cells: Vec<&str>| format!("| {} |", cells.join(" | "));
    let head = line(shown.iter().map(|column| heads[*column]).collect());
    let mut text = format!("{head}\n|{}", "---|".repeat(shown.len()));
    for row in &all {
        let cells = shown.iter().map(|column| row[*column].as_str());
        let _ = write!(text, "\n{}", line(cells.collect()));
    }
    text
}

/// A paragraph in lines of at most so many columns, each indented.
fn wrapped(paragraph: &str, columns: usize, indent: &str) -> String {
    let mut text = String::from(indent);
    let mut width = indent.len();
    for word in paragraph.split_whitespace() {
        let length = word.chars().count();
        if width > indent.len() && width + 1 + length > columns {
            text = text + "\n" + indent;
            width = indent.len();
        } else if width > indent.len() {
            text.push(' ');
            width += 1;
        }
        text += word;
        width += length;
    }
    text
}

#[cfg(test)]
mod tests {
    use super::wrapped;

    #[test]
    fn no_line_is_longer_than_the_terminal_and_no_word_is_lost() {
        let paragraph = "the base is not level and the shaft is not horizontal ".repeat(5);
        for columns in [20, 40, 80] {
            let text = wrapped(&paragraph, columns, "    ");
            assert!(text.lines().all(|line| line.len() <= columns), "{text}");
            let words: Vec<&str> = text.split_whitespace().collect();
            assert_eq!(words, Vec::from_iter(paragraph.split_whitespace()));
        }
    }
}
