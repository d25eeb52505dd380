//! How a graph is run, and what can go wrong before it is.
//!
//! Unaware of: the command line.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::graph::GraphError;
use super::remote::Remote;
use crate::disk::Jobserver;

/// How to plan and run a graph.
#[derive(Clone, Debug)]
pub struct Options {
    /// Threads, at least one; at most this many steps are under way at a time. Results do not depend on it.
    pub jobs: usize,
    /// After a failure go on with the steps that do not depend on it.
    pub keep_going: bool,
    /// Only report what would be done; write nothing.
    pub dry_run: bool,
    /// Run every needed step, whatever is known.
    pub force: bool,
    /// The graph holds everything that is ever built here: records of other steps are forgotten.
    pub whole_tree: bool,
    /// Remove the outputs of recipes that are gone; needs `whole_tree`. Else they are only reported.
    pub prune: bool,
    /// An earlier run was killed: remove what it left unfinished, that is what nobody is writing and is not newer than this
    /// time of the file system in nanoseconds since 1970.
    pub clean: Option<i128>,
    /// Steps start only while the estimates of those under way are below so many bytes together; one always may.
    pub memory: u64,
    /// Set by whoever wants the run to end: no further step starts, and what is done is kept.
    pub interrupt: Arc<AtomicBool>,
    /// Who lends threads beyond the first; without one all `jobs` are ours.
    pub jobserver: Option<Arc<Jobserver>>,
    /// Who may help from other machines; not asked if steps are forced to run.
    pub remote: Option<Arc<dyn Remote>>,
    /// Folder of the cache.
    pub cache: PathBuf,
    /// File of the manifest; a file `clock` beside it tells the file system's time.
    pub manifest: PathBuf,
    /// Artefacts that later steps want stay in memory up to this many bytes; beyond it they are read back.
    pub hold_bytes: u64,
    /// Largest input or output file that is read, in bytes.
    pub file_limit: u64,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            jobs: std::thread::available_parallelism().map_or(1, usize::from),
            keep_going: false,
            dry_run: false,
            force: false,
            whole_tree: false,
            prune: false,
            clean: None,
            memory: u64::MAX,
            interrupt: Arc::default(),
            jobserver: None,
            remote: None,
            cache: PathBuf::from(".kiln/cache"),
            manifest: PathBuf::from(".kiln/manifest"),
            hold_bytes: 1 << 30,
            file_limit: 8 << 30,
        }
    }
}

/// Why nothing could be run at all. Failures of steps are in the report instead.
#[derive(Debug)]
#[non_exhaustive]
pub enum Error {
    /// The graph contradicts itself.
    Graph(GraphError),
    /// The operating system gives no threads.
    Threads(Box<dyn std::error::Error + Send + Sync>),
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Error::Graph(_) => None,
            Error::Threads(source) => Some(source.as_ref()),
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Graph(error) => fmt::Display::fmt(error, f),
            Error::Threads(_) => f.write_str("cannot start worker threads"),
        }
    }
}

impl From<GraphError> for Error {
    fn from(error: GraphError) -> Self {
        Error::Graph(error)
    }
}
