//! The connection to a server, on a thread of its own: everything else in kiln waits for its answers.
//!
//! Every call has a deadline. Unaware of: what is said.

use std::fmt;
use std::future::Future;
use std::sync::mpsc;
use std::time::Duration;

use tokio::runtime::{Builder, Handle};
use tokio::sync::oneshot;
use tonic::metadata::{AsciiMetadataKey, AsciiMetadataValue};
use tonic::service::Interceptor;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::{Channel, ClientTlsConfig, Endpoint};
use tonic::{Code, Request, Status};

/// What goes over the wire.
pub type Wire = InterceptedService<Channel, Header>;

/// How a call ended that did not succeed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// The server does not have it.
    Missing,
    /// The server does not want to.
    Refused(String),
    /// There is no server, or no answer in time.
    Lost(String),
    /// What it said cannot be.
    Wrong(String),
}

impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Trouble::Missing => f.write_str("it does not have what it should"),
            Trouble::Refused(why) | Trouble::Lost(why) | Trouble::Wrong(why) => f.write_str(why),
        }
    }
}

impl From<Status> for Trouble {
    fn from(status: Status) -> Self {
        let why = || {
            let said = status.message().lines().next().unwrap_or("").trim();
            let cause = std::error::Error::source(&status).map(with_causes).unwrap_or_default();
            [&format!("{}", status.code()), said, &cause].iter().filter(|part| !part.is_empty()).fold(
                String::new(),
                |text, part| if text.is_empty() { part.to_string() } else { format!("{text}: {part}") },
            )
        };
        match status.code() {
            Code::NotFound => Trouble::Missing,
            Code::PermissionDenied
            | Code::Unauthenticated
            | Code::Unimplemented
            | Code::FailedPrecondition
            | Code::ResourceExhausted
            | Code::InvalidArgument => Trouble::Refused(why()),
            Code::OutOfRange => Trouble::Wrong(why()),
            _ => Trouble::Lost(why()),
        }
    }
}

fn with_causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(c) = cause {
        text += &format!(": {c}");
        cause = c.source();
    }
    text
}

/// A header that every call bears, such as a token.
#[derive(Clone, Debug, Default)]
pub struct Header(Option<(AsciiMetadataKey, AsciiMetadataValue)>);

impl Header {
    /// From `name: value`.
    pub fn parse(text: &str) -> Option<Self> {
        let (name, value) = text.split_once(':')?;
        let mut value: AsciiMetadataValue = value.trim().parse().ok()?;
        value.set_sensitive(true);
        Some(Header(Some((name.trim().to_ascii_lowercase().parse().ok()?, value))))
    }
}

impl Interceptor for Header {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some((name, value)) = &self.0 {
            request.metadata_mut().insert(name.clone(), value.clone());
        }
        Ok(request)
    }
}

/// A connection, or what will be one.
pub struct Link {
    handle: Handle,
    pub wire: Wire,
    /// The thread ends when this is dropped.
    _end: oneshot::Sender<()>,
}

impl Link {
    /// Starts the thread and connects. `url`: `grpc://host:port`, or `grpcs://` for TLS.
    pub fn new(url: &str, header: Header, timeout: Duration) -> Result<Self, Trouble> {
        let lost = |e: &dyn std::error::Error| Trouble::Lost(with_causes(e));
        let (plain, tls) = match url.split_once("://") {
            Some(("grpc", rest)) => (format!("http://{rest}"), false),
            Some(("grpcs", rest)) => (format!("https://{rest}"), true),
            _ => return Err(Trouble::Lost(format!("{url} is no address"))),
        };
        let mut endpoint = Endpoint::from_shared(plain).map_err(|e| lost(&e))?.connect_timeout(timeout);
        if tls {
            endpoint = endpoint.tls_config(ClientTlsConfig::new().with_native_roots()).map_err(|e| lost(&e))?;
        }
        let runtime = Builder::new_current_thread().enable_all().build().map_err(|e| lost(&e))?;
        let handle = runtime.handle().clone();
        let (end, ended) = oneshot::channel::<()>();
        let thread = std::thread::Builder::new().name("remote".to_string());
        let started = thread.spawn(move || {
            // An error means that the other end was dropped, which is what is waited for.
            let _ = runtime.block_on(ended);
            // Whatever hangs, such as the look-up of a name, is left behind.
            runtime.shutdown_background();
        });
        started.map_err(|e| lost(&e))?;
        let connected = wait(&handle, timeout, async move { endpoint.connect().await.map_err(|e| lost(&e)) })?;
        Ok(Link { handle, wire: InterceptedService::new(connected, header), _end: end })
    }

    /// Waits for an answer, at most so long.
    pub fn call<T: Send + 'static>(
        &self,
        limit: Duration,
        work: impl Future<Output = Result<T, Trouble>> + Send + 'static,
    ) -> Result<T, Trouble> {
        wait(&self.handle, limit, work)
    }

    /// Goes on without waiting; `then` gets the answer, on the connection's thread.
    pub fn send(
        &self,
        limit: Duration,
        work: impl Future<Output = Result<(), Trouble>> + Send + 'static,
        then: impl FnOnce(Result<(), Trouble>) + Send + 'static,
    ) {
        self.handle.spawn(async move { then(bounded(limit, work).await) });
    }
}

async fn bounded<T>(limit: Duration, work: impl Future<Output = Result<T, Trouble>>) -> Result<T, Trouble> {
    let late = |_| Trouble::Lost(format!("no answer within {:.1} s", limit.as_secs_f64()));
    tokio::time::timeout(limit, work).await.map_err(late)?
}

fn wait<T: Send + 'static>(
    handle: &Handle,
    limit: Duration,
    work: impl Future<Output = Result<T, Trouble>> + Send + 'static,
) -> Result<T, Trouble> {
    let (told, answer) = mpsc::sync_channel(1);
    handle.spawn(async move {
        let _ = told.send(bounded(limit, work).await);
    });
    answer.recv().unwrap_or_else(|_| Err(Trouble::Lost("the connection's thread has ended".to_string())))
}
