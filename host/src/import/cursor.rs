//! Numbers out of bytes, in either order, without ever reading past the end.

/// The bytes end before what should be there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Cut;

/// The order of bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Endian {
    Little,
    Big,
}

/// Bytes, and how far they are read.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    order: Endian,
}

/// A reader of one number, as f64.
macro_rules! number {
    ($name:ident, $type:ty) => {
        #[doc = concat!("A number stored as ", stringify!($type), ".")]
        pub(super) fn $name(&mut self) -> Result<f64, Cut> {
            self.array().map(|bytes| match self.order {
                Endian::Little => <$type>::from_le_bytes(bytes) as f64,
                Endian::Big => <$type>::from_be_bytes(bytes) as f64,
            })
        }
    };
}

impl<'a> Cursor<'a> {
    /// At the beginning of bytes.
    pub(super) fn new(bytes: &'a [u8], order: Endian) -> Self {
        Self {
            bytes,
            at: 0,
            order,
        }
    }

    /// Bytes that are read or skipped.
    pub(super) fn position(&self) -> usize {
        self.at
    }

    /// Whether none are left.
    pub(super) fn is_empty(&self) -> bool {
        self.at >= self.bytes.len()
    }

    /// How many are left.
    pub(super) fn left(&self) -> usize {
        self.bytes.len().saturating_sub(self.at)
    }

    /// Goes on by so many bytes, or to the end.
    pub(super) fn skip(&mut self, count: usize) {
        self.at = self.at.saturating_add(count).min(self.bytes.len());
    }

    /// The next bytes.
    pub(super) fn bytes(&mut self, count: usize) -> Result<&'a [u8], Cut> {
        let end = self.at.checked_add(count).ok_or(Cut)?;
        let found = self.bytes.get(self.at..end).ok_or(Cut)?;
        self.at = end;
        Ok(found)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Cut> {
        self.bytes(N)?.try_into().map_err(|_| Cut)
    }

    /// An unsigned number of 32 bits.
    pub(super) fn u32(&mut self) -> Result<u32, Cut> {
        self.array().map(|bytes| match self.order {
            Endian::Little => u32::from_le_bytes(bytes),
            Endian::Big => u32::from_be_bytes(bytes),
        })
    }

    /// An unsigned number of 64 bits.
    pub(super) fn u64(&mut self) -> Result<u64, Cut> {
        self.array().map(|bytes| match self.order {
            Endian::Little => u64::from_le_bytes(bytes),
            Endian::Big => u64::from_be_bytes(bytes),
        })
    }

    /// A length of 32 bits, and text of it.
    pub(super) fn text(&mut self) -> Result<String, Cut> {
        let length = self.u32()? as usize;
        Ok(String::from_utf8_lossy(self.bytes(length)?).into_owned())
    }

    number!(i8, i8);
    number!(u8, u8);
    number!(i16, i16);
    number!(u16, u16);
    number!(i32, i32);
    number!(i64, i64);
    number!(f32, f32);
    number!(f64, f64);

    /// All numbers to the end.
    pub(super) fn all(
        mut self,
        read: impl Fn(&mut Self) -> Result<f64, Cut>,
    ) -> Result<Vec<f64>, Cut> {
        let mut numbers = Vec::new();
        while !self.is_empty() {
            numbers.push(read(&mut self)?);
        }
        Ok(numbers)
    }
}
