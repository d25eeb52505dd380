//! `kiln.toml`.

use super::Recipe;
use super::ranges::{filled, within};
use crate::recipe::limits;
use crate::recipe::words::RemoteMode;
use schemars::JsonSchema;
use serde::Deserialize;

/// `kiln.toml`: what holds for every recipe of a project.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Project {
    /// Any recipe table, merged under each recipe.
    pub defaults: Option<Recipe>,
    /// Where artefacts are kept.
    pub cache: Cache,
}

/// Where artefacts are kept.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Cache {
    /// Folder, relative to `kiln.toml`. Default: chosen by kiln.
    #[schemars(transform = filled)]
    pub path: Option<String>,
    /// The cache is trimmed to so many bytes. Default: no bound.
    #[schemars(range(min = 0))]
    pub max_size: Option<u64>,
    /// A server of the Remote Execution API v2 that is asked for what is not in the folder: "grpc://host:port", or
    /// "grpcs://host:port" for TLS. A token goes into the environment variable KILN_REMOTE_HEADER, as "name: value".
    #[schemars(transform = filled)]
    pub remote: Option<String>,
    /// The server's instance. Default: its default one.
    pub remote_instance: String,
    /// Whether results are stored there, too. Default: "read-write".
    pub remote_mode: Option<RemoteMode>,
    /// Have long steps done by the server's workers. Default: false.
    pub remote_execute: bool,
    /// Longest time for an answer, in seconds. Default: 10.
    #[schemars(transform = within(limits::REMOTE_TIMEOUT))]
    pub remote_timeout: Option<u64>,
    /// Longest time for a step on a worker, waiting for one included, in seconds. Default: 600.
    #[schemars(transform = within(limits::REMOTE_TIMEOUT))]
    pub remote_execute_timeout: Option<u64>,
    /// What kind of machine a worker has to be, in the server's own words, such as ["OSFamily=linux", "ISA=x86-64"].
    pub remote_platform: Vec<String>,
}
