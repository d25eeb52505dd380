//! Other machines: who is asked, and what kiln does when it is the worker.

use std::path::Path;
use std::sync::Arc;

use crate::build::{ARTEFACT, Bytes, Digest, INPUTS, ORDER, Remote};
use crate::disk::{Disk, Real};
use crate::recipe;
use crate::stage::errand::{self, Orders};

use super::args::Global;
use super::bake::with_causes;
use super::{Done, Stop};

/// Orders hold a recipe and names of files.
const ORDER_LIMIT: u64 = 64 << 20;

/// The server that the command line or `kiln.toml` names, if one does.
pub(super) fn ask(
    global: &Global,
    settings: &recipe::Remote,
    orders: impl FnOnce() -> Orders,
) -> Result<Option<Arc<dyn Remote>>, Stop> {
    let url = global.remote.as_ref().or(settings.url.as_ref());
    match url.filter(|url| *url != "none") {
        Some(url) => client(global, settings, url, orders),
        None if global.remote_execute && global.remote.is_none() => Err(Stop::Usage(
            "--remote-execute needs a server: say --remote, or `remote` in [cache] of kiln.toml".into(),
        )),
        None => Ok(None),
    }
}

/// Whoever asks for a server wants one; a project that has one can be baked without.
#[cfg(not(feature = "remote"))]
fn client(
    global: &Global,
    _: &recipe::Remote,
    url: &str,
    _: impl FnOnce() -> Orders,
) -> Result<Option<Arc<dyn Remote>>, Stop> {
    use std::io::Write;
    let said = "this kiln cannot ask servers; build it with `--features remote`";
    if global.remote.is_some() || global.remote_execute {
        return Err(Stop::Usage(format!("{url}: {said}")));
    }
    if !global.quiet {
        let _ = writeln!(anstream::stderr(), "warning: {url}: {said}, or say `--remote none`; going on without it");
    }
    Ok(None)
}

#[cfg(feature = "remote")]
fn client(
    global: &Global,
    settings: &recipe::Remote,
    url: &str,
    orders: impl FnOnce() -> Orders,
) -> Result<Option<Arc<dyn Remote>>, Stop> {
    use crate::recipe::RemoteMode;
    use crate::remote::{Client, Settings, Workshop};
    use std::time::Duration;

    let recipe::Remote { url: _, instance, mode, execute, timeout, execute_timeout, platform } = settings.clone();
    let execute = execute || global.remote_execute;
    let mode = global.remote_mode.unwrap_or(mode);
    let settings = Settings {
        url: url.to_string(),
        instance,
        upload: mode == RemoteMode::ReadWrite,
        // Whoever may not write cannot hand in work either.
        execute: execute && mode == RemoteMode::ReadWrite,
        timeout: Duration::from_secs(timeout),
        execute_timeout: Duration::from_secs(execute_timeout),
        platform: platform.into_iter().collect(),
        header: std::env::var("KILN_REMOTE_HEADER").ok(),
    };
    let workshop = settings.execute.then(|| {
        let orders = orders();
        let program = || Real.read(&std::env::current_exe()?, u64::MAX);
        Workshop { order: Box::new(move |step| orders.order(&Real, step)), program: Box::new(program) }
    });
    Ok(Some(Arc::new(Client::new(settings, workshop))))
}

/// Does one step where this process was started: what a server's worker runs.
pub(super) fn step(key: &str) -> Result<Done, Stop> {
    let key = Digest::from_hex(key).ok_or_else(|| Stop::Usage(format!("{key} is no key")))?;
    let fail = |path: &Path, e: std::io::Error| Stop::Failed(format!("{}: {e}", path.display()));
    let order = Real.read(Path::new(ORDER), ORDER_LIMIT).map_err(|e| fail(Path::new(ORDER), e))?;
    let files = Real.list(Path::new(INPUTS)).map_err(|e| fail(Path::new(INPUTS), e))?;
    let read = |path: &std::path::PathBuf| Real.read(path, u64::MAX).map(Bytes::from).map_err(|e| fail(path, e));
    let inputs = files.iter().map(read).collect::<Result<Vec<Bytes>, Stop>>()?;
    let artefact = errand::carry_out(&order, &key, inputs).map_err(|e| Stop::Failed(with_causes(e.as_ref())))?;
    Real.write(Path::new(ARTEFACT), &artefact).map_err(|e| fail(Path::new(ARTEFACT), e))?;
    Done::ok("")
}
