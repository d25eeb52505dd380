//! A cache and workers on other machines, by the Remote Execution API v2 (cargo feature `remote`).
//!
//! ```text
//!   build::Remote ---> Client ---> messages (what is said)
//!                         '------> store (blobs) ---> link (a thread, a connection, deadlines)
//! ```
//!
//! Source: <https://github.com/bazelbuild/remote-apis>, `remote_execution.proto`, version 2. Spoken by buildbox, BuildGrid,
//! Buildbarn, BuildBuddy, NativeLink, and as a cache alone by bazel-remote.
//!
//! A server may be absent, slow, wrong, or die at any time. All calls have deadlines; whoever does not answer in time, is not
//! there, or says what cannot be, is given up for the rest of the run, once for all threads, with one warning. What a server
//! does not have is no fault. All bytes are compared with their SHA-256, and by the engine with their BLAKE3.
//!
//! Unaware of: steps, recipes, files.

mod link;
mod messages;
mod state;
mod store;

use std::collections::BTreeMap;
use std::fmt;
use std::io;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use bazel_remote_apis::build::bazel::remote::execution::v2 as re;
use bazel_remote_apis::google::longrunning::operation;
use prost::Message;
use re::action_cache_client::ActionCacheClient;
use re::capabilities_client::CapabilitiesClient;
use re::execution_client::ExecutionClient;

use crate::build::{Bytes, Digest, Errand, Finished, Record, Remote, StepId};
use link::{Header, Link, Trouble};
use messages::{Blob, Work};
use state::State;
use store::Store;

/// A transfer that is slower than this many bytes a second has no end in sight.
const SLOWEST: u64 = 1 << 20;
/// Largest artefact that is fetched, in bytes.
const ARTEFACT_LIMIT: i64 = 8 << 30;
/// A look-up that takes longer than this part of its deadline is slow...
const SLOW_PART: u32 = 10;
/// ... and after so many of them a server is given up.
const SLOW_MOST: u32 = 10;
/// After so many steps that workers could not do, none is asked any more.
const FAILURES: u32 = 3;

/// Where the others are, and what they are asked.
#[derive(Clone, Debug)]
pub struct Settings {
    /// `grpc://host:port`, or `grpcs://` for TLS with the system's certificates.
    pub url: String,
    /// The server's instance; empty: the default one.
    pub instance: String,
    /// Whether results from here are stored there.
    pub upload: bool,
    /// Whether workers are asked to do steps.
    pub execute: bool,
    /// Deadline of a call; transfers and steps get more.
    pub timeout: Duration,
    /// Longest time for a step on a worker, waiting for one included.
    pub execute_timeout: Duration,
    /// What kind of machine a worker has to be: the server's own names and values.
    pub platform: BTreeMap<String, String>,
    /// A header of every call, `name: value`, such as a token.
    pub header: Option<String>,
}

/// What workers need beside a step's inputs.
pub struct Workshop {
    /// What a worker has to know to do a step of the graph; `None`: it cannot be done elsewhere.
    pub order: Box<dyn Fn(StepId) -> Option<Vec<u8>> + Send + Sync>,
    /// The program that workers run: kiln.
    pub program: Box<dyn Fn() -> io::Result<Vec<u8>> + Send + Sync>,
}

/// A server, or what will be one once something is asked.
pub struct Client {
    settings: Settings,
    workshop: Option<Workshop>,
    /// What workers run, once it is there.
    program: OnceLock<Result<Blob, Trouble>>,
    server: OnceLock<Option<Server>>,
    /// What artefacts are called there, by key.
    names: Mutex<BTreeMap<Digest, re::Digest>>,
    state: Arc<State>,
}

/// A connected server.
struct Server {
    link: Link,
    store: Store,
}

impl fmt::Debug for Client {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Client").field("url", &self.settings.url).finish_non_exhaustive()
    }
}

impl Client {
    /// Asks nothing yet: a run with nothing to do needs no server. Without a workshop nothing is executed.
    pub fn new(settings: Settings, workshop: Option<Workshop>) -> Self {
        let state = Arc::new(State::new(&settings));
        let (program, server, names) = (OnceLock::new(), OnceLock::new(), Mutex::default());
        Client { settings, workshop, program, server, names, state }
    }

    /// The server, unless it has been given up. The first call connects; others wait for it.
    fn server(&self) -> Option<&Server> {
        if self.state.is_down() {
            return None;
        }
        let connect = || self.connect().map_err(|trouble| self.state.give_up(&trouble.to_string())).ok();
        self.server.get_or_init(connect).as_ref()
    }

    fn connect(&self) -> Result<Server, Trouble> {
        let Settings { url, instance, upload, execute, timeout, .. } = &self.settings;
        let bad = || Trouble::Refused("KILN_REMOTE_HEADER is not `name: value`".to_string());
        let header = self.settings.header.as_deref().map(|text| Header::parse(text).ok_or_else(bad)).transpose()?;
        let link = Link::new(url, header.unwrap_or_default(), *timeout)?;
        let request = re::GetCapabilitiesRequest { instance_name: instance.clone() };
        let mut client = CapabilitiesClient::new(link.wire.clone());
        let can = link.call(*timeout, async move { Ok(client.get_capabilities(request).await?.into_inner()) })?;
        let cache = can.cache_capabilities.unwrap_or_default();
        if !cache.digest_functions.contains(&(re::digest_function::Value::Sha256 as i32)) {
            return Err(Trouble::Refused("it does not know SHA-256".to_string()));
        }
        if *upload && !cache.action_cache_update_capabilities.unwrap_or_default().update_enabled {
            self.state.stop_uploads("it takes no results from here");
        }
        if *execute && !can.execution_capabilities.is_some_and(|can| can.exec_enabled) {
            self.state.stop_work("it has no workers");
        }
        let batch = usize::try_from(cache.max_batch_total_size_bytes).unwrap_or(0);
        let store = Store { wire: link.wire.clone(), instance: instance.clone(), batch };
        Ok(Server { link, store })
    }

    /// How long a transfer of so many bytes may take.
    fn transfer_time(&self, bytes: u64) -> Duration {
        self.settings.timeout + Duration::from_secs(bytes / SLOWEST)
    }

    fn ask(&self, server: &Server, key: &Digest) -> Result<(Record, re::Digest), Trouble> {
        let mut client = ActionCacheClient::new(server.link.wire.clone());
        let request = re::GetActionResultRequest {
            instance_name: self.settings.instance.clone(),
            action_digest: Some(messages::cached(key).name),
            inline_stdout: true,
            ..Default::default()
        };
        let store = server.store.clone();
        let result = server.link.call(self.settings.timeout, async move {
            let mut result = client.get_action_result(request).await?.into_inner();
            // Some servers keep even a line as a blob.
            if let Some(name) = result.stdout_digest.clone().filter(messages::is_line) {
                result.stdout_raw = store.read(name).await?;
            }
            Ok(result)
        })?;
        messages::record(&result).ok_or(Trouble::Missing)
    }

    /// Bytes under this name, of this hash.
    fn read(&self, server: &Server, name: re::Digest) -> Result<Vec<u8>, Trouble> {
        let limit = self.transfer_time(name.size_bytes as u64);
        let (store, wanted) = (server.store.clone(), name.clone());
        let bytes = server.link.call(limit, async move { store.read(wanted).await })?;
        if messages::name_of(&bytes) != name {
            return Err(Trouble::Wrong("it sent other bytes than their SHA-256 says".to_string()));
        }
        self.state.count(|counts| counts.down += bytes.len() as u64);
        Ok(bytes)
    }

    fn send(&self, server: &Server, blobs: Vec<Blob>) -> Result<(), Trouble> {
        let limit = self.transfer_time(blobs.iter().map(|blob| blob.bytes.len() as u64).sum());
        let store = server.store.clone();
        let sent = server.link.call(limit, async move { store.upload(blobs).await })?;
        self.state.count(|counts| counts.up += sent);
        Ok(())
    }

    /// Sends kiln itself, once: many steps need it at the same moment.
    fn send_program(&self, server: &Server, workshop: &Workshop) -> Result<Blob, Trouble> {
        let bytes = (workshop.program)().map_err(|e| Trouble::Refused(format!("kiln cannot read itself: {e}")))?;
        let program = Blob::new(bytes.into());
        self.send(server, vec![program.clone()])?;
        Ok(program)
    }

    fn work(&self, server: &Server, workshop: &Workshop, errand: &Errand) -> Result<Vec<u8>, Trouble> {
        let refuse = |why: &str| Trouble::Refused(why.to_string());
        let order = (workshop.order)(errand.step).ok_or_else(|| refuse("it cannot be told to workers"))?;
        let program = self.program.get_or_init(|| self.send_program(server, workshop)).clone()?;
        let inputs = (0..errand.inputs.len()).filter_map(|index| errand.inputs.get(index).cloned()).collect();
        let (platform, seconds) = (self.settings.platform.clone(), self.settings.execute_timeout.as_secs());
        let action = messages::work(errand.key, Work { program, order: order.into(), inputs, platform, seconds });
        self.send(server, action.blobs)?;
        let request = re::ExecuteRequest {
            instance_name: self.settings.instance.clone(),
            action_digest: Some(action.name),
            inline_stderr: true,
            ..Default::default()
        };
        let mut client = ExecutionClient::new(server.link.wire.clone());
        let limit = self.settings.execute_timeout + self.settings.timeout;
        let result = server.link.call(limit, async move {
            let mut operations = client.execute(request).await?.into_inner();
            while let Some(operation) = operations.message().await? {
                match operation.result {
                    Some(operation::Result::Error(status)) => store::check(Some(status))?,
                    Some(operation::Result::Response(any)) => {
                        let response = re::ExecuteResponse::decode(&*any.value);
                        let response = response.map_err(|e| Trouble::Wrong(e.to_string()))?;
                        store::check(response.status)?;
                        return Ok(response.result.unwrap_or_default());
                    }
                    None => {}
                }
            }
            Err(Trouble::Lost("it said no more before the step was done".to_string()))
        })?;
        if result.exit_code != 0 {
            let said = String::from_utf8_lossy(&result.stderr_raw);
            let said = said.lines().next_back().unwrap_or("it said nothing");
            return Err(refuse(&format!("the worker ended with {}: {said}", result.exit_code)));
        }
        let name = messages::artefact(&result).filter(|name| name.size_bytes <= ARTEFACT_LIMIT);
        self.read(server, name.ok_or_else(|| refuse("the worker left no artefact"))?)
    }

    /// What to do about trouble with something that was asked.
    fn after(&self, trouble: Trouble) {
        if trouble != Trouble::Missing {
            self.state.give_up(&trouble.to_string());
        }
    }
}

impl Remote for Client {
    fn record(&self, key: &Digest) -> Option<Record> {
        let server = self.server()?;
        let begun = Instant::now();
        let answer = self.ask(server, key);
        let slow = begun.elapsed() > self.settings.timeout / SLOW_PART;
        if slow && self.state.slow.fetch_add(1, Ordering::Relaxed) + 1 == SLOW_MOST {
            self.state.give_up("it answers too slowly to be of use");
        }
        self.state.count(|counts| counts.asked += 1);
        let (record, name) = answer.map_err(|trouble| self.after(trouble)).ok()?;
        self.state.count(|counts| counts.found += 1);
        self.names.lock().unwrap_or_else(PoisonError::into_inner).insert(*key, name);
        Some(record)
    }

    fn load(&self, key: &Digest, record: &Record) -> Option<Vec<u8>> {
        let server = self.server()?;
        let known = self.names.lock().unwrap_or_else(PoisonError::into_inner).get(key).cloned();
        let name = match known {
            Some(name) => name,
            None => {
                let (now, name) = self.ask(server, key).map_err(|trouble| self.after(trouble)).ok()?;
                Some(name).filter(|_| now.artefact == record.artefact)?
            }
        };
        if name.size_bytes as u64 != record.len {
            return None;
        }
        self.read(server, name).map_err(|trouble| self.after(trouble)).ok()
    }

    fn store(&self, key: &Digest, record: &Record, artefact: &Bytes) {
        if !self.state.uploads() {
            return;
        }
        let Some(server) = self.server().filter(|_| self.state.uploads()) else { return };
        let artefact = Blob::new(artefact.clone());
        let action = messages::cached(key);
        let request = re::UpdateActionResultRequest {
            instance_name: self.settings.instance.clone(),
            action_digest: Some(action.name),
            action_result: Some(messages::result(record, artefact.name.clone())),
            ..Default::default()
        };
        self.names.lock().unwrap_or_else(PoisonError::into_inner).insert(*key, artefact.name.clone());
        let blobs = [action.blobs, vec![artefact]].concat();
        let (store, mut client) = (server.store.clone(), ActionCacheClient::new(server.link.wire.clone()));
        let bytes = record.len;
        let (state, counted) = (State::begin_upload(&self.state, bytes), self.state.clone());
        let upload = async move {
            let sent = store.upload(blobs).await?;
            client.update_action_result(request).await?;
            counted.count(|counts| (counts.stored, counts.up) = (counts.stored + 1, counts.up + sent));
            Ok(())
        };
        server.link.send(self.transfer_time(bytes), upload, move |result| state.end(result));
    }

    fn execute(&self, errand: &Errand) -> Option<Vec<u8>> {
        let workshop = self.workshop.as_ref().filter(|_| self.state.works())?;
        let server = self.server().filter(|_| self.state.works())?;
        match self.work(server, workshop, errand) {
            Ok(bytes) => {
                self.state.count(|counts| counts.executed += 1);
                Some(bytes)
            }
            Err(Trouble::Wrong(why)) => {
                self.state.give_up(&why);
                None
            }
            Err(trouble) => {
                self.state.failed(errand.name, &trouble);
                None
            }
        }
    }

    fn distrust(&self, why: &str) {
        self.state.give_up(why);
    }

    fn finish(&self, wait: bool) -> Finished {
        if wait {
            self.state.wait_for_uploads();
        }
        self.state.finished()
    }
}
