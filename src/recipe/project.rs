//! What `kiln.toml` says of the cache, checked.
//!
//! Unaware of: recipes, networks.

use super::schema;
use super::validate::Context;
use super::values::{Cache, Remote};

/// Where artefacts are kept, and who is asked for others.
pub(super) fn cache(from: schema::Cache, context: &mut Context) -> Cache {
    let schema::Cache {
        path,
        max_size,
        remote,
        remote_instance,
        remote_mode,
        remote_execute,
        remote_timeout,
        remote_execute_timeout,
        remote_platform,
    } = from;
    if let Some(url) = remote.as_ref().filter(|url| !is_address(url)) {
        refuse(context, "cache.remote", url, "\"grpc://host:port\" or \"grpcs://host:port\"");
    }
    let mut platform = Vec::new();
    for (index, property) in remote_platform.iter().enumerate() {
        match property.split_once('=') {
            Some((name, value)) if !name.trim().is_empty() => {
                platform.push((name.trim().to_string(), value.trim().to_string()));
            }
            _ => refuse(context, &format!("cache.remote_platform[{index}]"), property, "\"name=value\""),
        }
    }
    let default = Remote::default();
    let remote = Remote {
        url: remote,
        instance: remote_instance,
        mode: remote_mode.unwrap_or(default.mode),
        execute: remote_execute,
        timeout: remote_timeout.unwrap_or(default.timeout),
        execute_timeout: remote_execute_timeout.unwrap_or(default.execute_timeout),
        platform,
    };
    Cache { path: path.map(|written| context.file("cache.path", written)), max_size, remote }
}

fn refuse(context: &mut Context, key: &str, found: &str, allowed: &str) {
    let fault = context.fault(key, format!("`{key}` can't be {found:?}"));
    context.findings.push(fault.found(found).allowed(allowed));
}

/// Whether this is a server's address: a scheme that kiln speaks, a host and perhaps a port.
pub fn is_address(text: &str) -> bool {
    let rest = text.strip_prefix("grpc://").or_else(|| text.strip_prefix("grpcs://"));
    rest.is_some_and(|rest| !rest.is_empty() && rest.bytes().all(|b| b.is_ascii_graphic() && !b"/?#@".contains(&b)))
}
