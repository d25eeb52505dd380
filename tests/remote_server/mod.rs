//! A server of the Remote Execution API in memory that can be told to misbehave.

use std::collections::BTreeMap;
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bazel_remote_apis::build::bazel::remote::execution::v2 as re;
use bazel_remote_apis::google::bytestream as bs;
use bazel_remote_apis::google::longrunning::{Operation, operation};
use bazel_remote_apis::google::protobuf::Any;
use bazel_remote_apis::google::rpc;
use bs::byte_stream_server::{ByteStream, ByteStreamServer};
use prost::Message;
use re::action_cache_server::{ActionCache, ActionCacheServer};
use re::capabilities_server::{Capabilities, CapabilitiesServer};
use re::content_addressable_storage_server::{ContentAddressableStorage, ContentAddressableStorageServer};
use re::execution_server::{Execution, ExecutionServer};
use tonic::codegen::tokio_stream::{self, Stream};
use tonic::transport::server::TcpIncoming;
use tonic::{Request, Response, Status, Streaming};

/// What it does wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    None,
    /// Blobs have another first byte.
    WrongBytes,
    /// Blobs end early.
    TooFew,
    /// Blobs go on and on.
    TooMany,
    /// Results are there, their blobs are not.
    AbsentBlobs,
    /// Results name another artefact, soundly.
    FalseDigest,
    /// Results name an artefact of many terabytes.
    Oversized,
    /// Results are of another kind.
    Nonsense,
    /// Results do not fit into a message.
    HugeMessage,
    /// Answers come after a minute.
    Stalls,
    /// Answers come after a moment.
    Slow,
    Unavailable,
    RefusesWrites,
    /// It knows other hashes only.
    OtherHash,
    /// Nobody does anything.
    NoWorkers,
    /// Executions end with a status, as those of a broken server do.
    StatusOnly,
    /// Executions succeed and leave nothing.
    NoOutputs,
    /// Commands fail.
    ExitCode,
    /// Executions leave something under another name.
    FalseOutput,
}

/// What was asked of it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seen {
    pub calls: u32,
    pub lookups: u32,
    pub updates: u32,
    pub batches: u32,
    pub writes: u32,
    pub executions: u32,
}

#[derive(Default)]
struct State {
    results: BTreeMap<String, re::ActionResult>,
    blobs: BTreeMap<String, Vec<u8>>,
    seen: Seen,
}

#[derive(Clone)]
struct Service {
    state: Arc<Mutex<State>>,
    fault: Arc<Mutex<Fault>>,
}

/// A running server; it ends with the test.
pub struct Server {
    service: Service,
    port: u16,
}

impl Server {
    pub fn start(fault: Fault) -> Self {
        let service = Service { state: Arc::default(), fault: Arc::new(Mutex::new(fault)) };
        let (told, port) = std::sync::mpsc::channel();
        let here = service.clone();
        std::thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
            runtime.block_on(async move {
                let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.expect("a port");
                told.send(listener.local_addr().expect("an address").port()).expect("the test waits");
                let server = tonic::transport::Server::builder()
                    .add_service(CapabilitiesServer::new(here.clone()))
                    .add_service(ActionCacheServer::new(here.clone()))
                    .add_service(ContentAddressableStorageServer::new(here.clone()))
                    .add_service(ByteStreamServer::new(here.clone()))
                    .add_service(ExecutionServer::new(here));
                server.serve_with_incoming(TcpIncoming::from(listener)).await.expect("a server");
            });
        });
        Server { service, port: port.recv().expect("a port") }
    }

    pub fn url(&self) -> String {
        format!("grpc://127.0.0.1:{}", self.port)
    }

    pub fn set(&self, fault: Fault) {
        *self.service.fault.lock().expect("a lock") = fault;
    }

    pub fn seen(&self) -> Seen {
        self.service.state.lock().expect("a lock").seen
    }
}

impl Service {
    /// Begins a call: counts it, and does what goes wrong with all calls.
    async fn begin(&self, count: impl FnOnce(&mut Seen)) -> Result<Fault, Status> {
        {
            let mut state = self.state.lock().expect("a lock");
            state.seen.calls += 1;
            count(&mut state.seen);
        }
        let fault = *self.fault.lock().expect("a lock");
        match fault {
            Fault::Stalls => tokio::time::sleep(Duration::from_secs(60)).await,
            Fault::Slow => tokio::time::sleep(Duration::from_millis(150)).await,
            Fault::Unavailable => return Err(Status::unavailable("on holiday")),
            _ => {}
        }
        Ok(fault)
    }

    fn keep(&self, name: &str, bytes: Vec<u8>) {
        self.state.lock().expect("a lock").blobs.insert(name.to_string(), bytes);
    }
}

fn hash(digest: Option<re::Digest>) -> String {
    digest.map(|digest| digest.hash).unwrap_or_default()
}

type Answer<T> = Result<Response<T>, Status>;
type Many<T> = Pin<Box<dyn Stream<Item = Result<T, Status>> + Send>>;

fn many<T: Send + 'static>(items: Vec<T>) -> Many<T> {
    Box::pin(tokio_stream::iter(items.into_iter().map(Ok)))
}

#[tonic::async_trait]
impl Capabilities for Service {
    async fn get_capabilities(&self, _: Request<re::GetCapabilitiesRequest>) -> Answer<re::ServerCapabilities> {
        let fault = self.begin(|_| {}).await?;
        let sha = if fault == Fault::OtherHash { 3 } else { 1 };
        let update = re::ActionCacheUpdateCapabilities { update_enabled: true };
        let cache = re::CacheCapabilities {
            digest_functions: vec![sha],
            action_cache_update_capabilities: Some(update),
            ..Default::default()
        };
        let exec_enabled = fault != Fault::NoWorkers;
        let execution = re::ExecutionCapabilities { digest_function: sha, exec_enabled, ..Default::default() };
        Ok(Response::new(re::ServerCapabilities {
            cache_capabilities: Some(cache),
            execution_capabilities: Some(execution),
            ..Default::default()
        }))
    }
}

#[tonic::async_trait]
impl ActionCache for Service {
    async fn get_action_result(&self, request: Request<re::GetActionResultRequest>) -> Answer<re::ActionResult> {
        let fault = self.begin(|seen| seen.lookups += 1).await?;
        let name = hash(request.into_inner().action_digest);
        let found = self.state.lock().expect("a lock").results.get(&name).cloned();
        let mut result = found.ok_or_else(|| Status::not_found("no such result"))?;
        match fault {
            Fault::FalseDigest => {
                // The first digit of the BLAKE3.
                let digit = &mut result.stdout_raw["blake3 ".len()];
                *digit = if *digit == b'a' { b'b' } else { b'a' };
                let file = &mut result.output_files[0].digest;
                file.iter_mut().for_each(|digest| digest.hash = "0".repeat(64));
            }
            Fault::Oversized => {
                result.output_files[0].digest.iter_mut().for_each(|digest| digest.size_bytes = i64::MAX / 2);
            }
            Fault::Nonsense => result.stdout_raw = b"hello".to_vec(),
            Fault::HugeMessage => result.stdout_raw = vec![b'x'; 8 << 20],
            _ => {}
        }
        Ok(Response::new(result))
    }

    async fn update_action_result(&self, request: Request<re::UpdateActionResultRequest>) -> Answer<re::ActionResult> {
        if self.begin(|seen| seen.updates += 1).await? == Fault::RefusesWrites {
            return Err(Status::permission_denied("not you"));
        }
        let request = request.into_inner();
        let result = request.action_result.unwrap_or_default();
        self.state.lock().expect("a lock").results.insert(hash(request.action_digest), result.clone());
        Ok(Response::new(result))
    }
}

#[tonic::async_trait]
impl ContentAddressableStorage for Service {
    async fn find_missing_blobs(
        &self,
        request: Request<re::FindMissingBlobsRequest>,
    ) -> Answer<re::FindMissingBlobsResponse> {
        self.begin(|_| {}).await?;
        let state = self.state.lock().expect("a lock");
        let missing = |digest: &re::Digest| !state.blobs.contains_key(&digest.hash);
        let missing_blob_digests = request.into_inner().blob_digests.into_iter().filter(missing).collect();
        Ok(Response::new(re::FindMissingBlobsResponse { missing_blob_digests }))
    }

    async fn batch_update_blobs(
        &self,
        request: Request<re::BatchUpdateBlobsRequest>,
    ) -> Answer<re::BatchUpdateBlobsResponse> {
        if self.begin(|seen| seen.batches += 1).await? == Fault::RefusesWrites {
            return Err(Status::permission_denied("not you"));
        }
        let mut responses = Vec::new();
        for upload in request.into_inner().requests {
            let response = re::batch_update_blobs_response::Response { digest: upload.digest.clone(), status: None };
            responses.push(response);
            self.keep(&hash(upload.digest), upload.data);
        }
        Ok(Response::new(re::BatchUpdateBlobsResponse { responses }))
    }

    async fn batch_read_blobs(&self, _: Request<re::BatchReadBlobsRequest>) -> Answer<re::BatchReadBlobsResponse> {
        Err(Status::unimplemented("kiln does not ask for it"))
    }

    type GetTreeStream = Many<re::GetTreeResponse>;
    async fn get_tree(&self, _: Request<re::GetTreeRequest>) -> Answer<Self::GetTreeStream> {
        Err(Status::unimplemented("kiln does not ask for it"))
    }

    async fn split_blob(&self, _: Request<re::SplitBlobRequest>) -> Answer<re::SplitBlobResponse> {
        Err(Status::unimplemented("kiln does not ask for it"))
    }

    async fn splice_blob(&self, _: Request<re::SpliceBlobRequest>) -> Answer<re::SpliceBlobResponse> {
        Err(Status::unimplemented("kiln does not ask for it"))
    }

    type GetChunkMappingStream = Many<re::GetChunkMappingResponse>;
    async fn get_chunk_mapping(&self, _: Request<re::GetChunkMappingRequest>) -> Answer<Self::GetChunkMappingStream> {
        Err(Status::unimplemented("kiln does not ask for it"))
    }

    async fn register_chunk_mapping(
        &self,
        _: Request<Streaming<re::RegisterChunkMappingRequest>>,
    ) -> Answer<re::RegisterChunkMappingResponse> {
        Err(Status::unimplemented("kiln does not ask for it"))
    }
}

#[tonic::async_trait]
impl ByteStream for Service {
    type ReadStream = Many<bs::ReadResponse>;
    async fn read(&self, request: Request<bs::ReadRequest>) -> Answer<Self::ReadStream> {
        let fault = self.begin(|_| {}).await?;
        let name = request.into_inner().resource_name;
        let hash = name.split('/').nth(1).unwrap_or("").to_string();
        let found = self.state.lock().expect("a lock").blobs.get(&hash).cloned();
        let mut bytes =
            found.filter(|_| fault != Fault::AbsentBlobs).ok_or_else(|| Status::not_found("no such blob"))?;
        match fault {
            Fault::WrongBytes => bytes[0] ^= 1,
            Fault::TooFew => bytes.truncate(bytes.len() / 2),
            Fault::TooMany => {
                let piece = vec![0; 1 << 20];
                let endless = std::iter::repeat_with(move || Ok(bs::ReadResponse { data: piece.clone() }));
                return Ok(Response::new(Box::pin(tokio_stream::iter(endless))));
            }
            _ => {}
        }
        let piece = |data: &[u8]| bs::ReadResponse { data: data.to_vec() };
        Ok(Response::new(many(bytes.chunks(100_000).map(piece).collect())))
    }

    async fn write(&self, request: Request<Streaming<bs::WriteRequest>>) -> Answer<bs::WriteResponse> {
        if self.begin(|seen| seen.writes += 1).await? == Fault::RefusesWrites {
            return Err(Status::permission_denied("not you"));
        }
        let mut stream = request.into_inner();
        let (mut name, mut bytes) = (String::new(), Vec::new());
        while let Some(piece) = stream.message().await? {
            name = if name.is_empty() { piece.resource_name } else { name };
            assert_eq!(piece.write_offset as usize, bytes.len(), "pieces in order");
            bytes.extend(piece.data);
        }
        let committed_size = bytes.len() as i64;
        self.keep(name.split('/').nth(3).unwrap_or(""), bytes);
        Ok(Response::new(bs::WriteResponse { committed_size }))
    }

    async fn query_write_status(
        &self,
        _: Request<bs::QueryWriteStatusRequest>,
    ) -> Answer<bs::QueryWriteStatusResponse> {
        Err(Status::unimplemented("kiln does not ask for it"))
    }
}

#[tonic::async_trait]
impl Execution for Service {
    type ExecuteStream = Many<Operation>;
    async fn execute(&self, _: Request<re::ExecuteRequest>) -> Answer<Self::ExecuteStream> {
        let fault = self.begin(|seen| seen.executions += 1).await?;
        let digest = re::Digest { hash: "1".repeat(64), size_bytes: 5 };
        let file = re::OutputFile { path: "elsewhere".to_string(), digest: Some(digest), ..Default::default() };
        let (mut result, mut status) = (re::ActionResult::default(), None);
        match fault {
            Fault::StatusOnly => status = Some(rpc::Status { code: 13, message: "no root".into(), details: vec![] }),
            Fault::ExitCode => {
                result.exit_code = 127;
                result.stderr_raw = b"kiln: not found\n".to_vec();
            }
            Fault::FalseOutput => result.output_files.push(file),
            _ => {}
        }
        let response = re::ExecuteResponse { result: Some(result), status, ..Default::default() };
        let any = Any { type_url: String::new(), value: response.encode_to_vec() };
        let under_way = Operation { name: "x".to_string(), ..Default::default() };
        let done = Operation { done: true, result: Some(operation::Result::Response(any)), ..under_way.clone() };
        Ok(Response::new(many(vec![under_way, done])))
    }

    type WaitExecutionStream = Many<Operation>;
    async fn wait_execution(&self, _: Request<re::WaitExecutionRequest>) -> Answer<Self::WaitExecutionStream> {
        Err(Status::unimplemented("kiln does not ask for it"))
    }
}
