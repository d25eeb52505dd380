//! Artefacts: what steps hand to each other, as bytes.
//!
//! A header (magic, tag of the type) and then fields in a fixed order, little-endian, arrays preceded by their length.
//! The cache checks the bytes by their hash before they are used, so a reader here meets damage only when a type's
//! layout changed without its step's revision; it then returns an error, never panics and never allocates more than the
//! bytes that are there. Unaware of: caches, keys, files.

mod types;

use bytemuck::Pod;

pub(crate) use types::{read_mesh, read_turning, set_count, surface_counts, write_turning};

/// Bytes that are not the artefact they should be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damaged(pub String);

impl std::fmt::Display for Damaged {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "a damaged artefact: {}", self.0)
    }
}

impl std::error::Error for Damaged {}

const MAGIC: [u8; 4] = *b"kiln";

/// A value that steps exchange.
pub trait Artefact: Sized {
    /// Four letters that tell the type.
    const TAG: [u8; 4];
    /// Appends all fields.
    fn write(&self, to: &mut Writer);
    /// Reads the fields in the same order and checks what the type promises.
    fn read(from: &mut Reader<'_>) -> Result<Self, Damaged>;

    /// Whether bytes begin as an artefact of this type.
    fn is_one(bytes: &[u8]) -> bool {
        bytes.starts_with(&MAGIC) && bytes[MAGIC.len()..].starts_with(&Self::TAG)
    }

    /// The whole artefact.
    fn to_bytes(&self) -> Vec<u8> {
        let mut w = Writer(Vec::new());
        w.0.extend_from_slice(&MAGIC);
        w.0.extend_from_slice(&Self::TAG);
        self.write(&mut w);
        w.0
    }

    /// Reads an artefact of this type from its first field on.
    fn open(bytes: &[u8]) -> Result<Reader<'_>, Damaged> {
        let mut r = Reader(bytes);
        if r.take(4)? != MAGIC || r.take(4)? != Self::TAG {
            return Err(Damaged(format!("not one of type {}", String::from_utf8_lossy(&Self::TAG))));
        }
        Ok(r)
    }

    /// The value of a whole artefact.
    fn from_bytes(bytes: &[u8]) -> Result<Self, Damaged> {
        let mut r = Self::open(bytes)?;
        let value = Self::read(&mut r)?;
        if r.0.is_empty() { Ok(value) } else { Err(Damaged(format!("{} bytes too many", r.0.len()))) }
    }
}

/// Grows an artefact field by field.
pub struct Writer(Vec<u8>);

impl Writer {
    /// One plain value.
    pub fn put<T: Pod>(&mut self, value: T) {
        self.0.extend_from_slice(bytemuck::bytes_of(&value));
    }

    /// An array: its length, then its items.
    pub fn slice<T: Pod>(&mut self, items: &[T]) {
        self.put(items.len() as u64);
        self.part(items);
    }

    /// An array of the first of all pairs, then one of the second.
    pub fn pairs<A: Pod, B: Pod>(&mut self, items: impl Iterator<Item = (A, B)>) {
        let (first, second): (Vec<A>, Vec<B>) = items.unzip();
        self.slice(&first);
        self.slice(&second);
    }

    /// Items of an array whose length was put before.
    fn part<T: Pod>(&mut self, items: &[T]) {
        self.0.extend_from_slice(bytemuck::cast_slice(items));
    }

    /// Makes room for so many more bytes, where it is known.
    pub fn reserve(&mut self, bytes: usize) {
        self.0.reserve_exact(bytes);
    }

    /// A text.
    pub fn text(&mut self, text: &str) {
        self.slice(text.as_bytes());
    }
}

/// Reads an artefact field by field.
pub struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8], Damaged> {
        let (head, rest) =
            self.0.split_at_checked(n).ok_or_else(|| Damaged(format!("{n} bytes expected, {} left", self.0.len())))?;
        self.0 = rest;
        Ok(head)
    }

    /// One plain value.
    pub fn get<T: Pod>(&mut self) -> Result<T, Damaged> {
        Ok(bytemuck::pod_read_unaligned(self.take(size_of::<T>())?))
    }

    /// An array.
    pub fn slice<T: Pod>(&mut self) -> Result<Vec<T>, Damaged> {
        let n = self.get::<u64>()?;
        Ok(bytemuck::pod_collect_to_vec(self.array_bytes::<T>(n)?))
    }

    /// What [`Writer::pairs`] wrote.
    pub fn pairs<A: Pod, B: Pod>(&mut self) -> Result<impl Iterator<Item = (A, B)> + use<A, B>, Damaged> {
        let (first, second): (Vec<A>, Vec<B>) = (self.slice()?, self.slice()?);
        check(first.len() == second.len(), "arrays of one length")?;
        Ok(first.into_iter().zip(second))
    }

    fn array_bytes<T>(&mut self, n: u64) -> Result<&'a [u8], Damaged> {
        let bytes = usize::try_from(n).ok().and_then(|n| n.checked_mul(size_of::<T>()));
        self.take(bytes.ok_or_else(|| Damaged(format!("an array of {n} items")))?)
    }

    /// How many items the array has that comes next; passes over it.
    pub fn pass<T: Pod>(&mut self) -> Result<usize, Damaged> {
        let n = self.get::<u64>()?;
        let bytes = self.array_bytes::<T>(n)?;
        Ok(bytes.len() / size_of::<T>())
    }

    /// A text.
    pub fn text(&mut self) -> Result<String, Damaged> {
        String::from_utf8(self.slice()?).map_err(|_| Damaged("a text that is not UTF-8".into()))
    }
}

/// `Ok` if the condition holds.
fn check(holds: bool, what: &str) -> Result<(), Damaged> {
    if holds { Ok(()) } else { Err(Damaged(what.into())) }
}
