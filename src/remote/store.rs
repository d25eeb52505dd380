//! Blobs to and from a server's content-addressable storage.
//!
//! Small ones travel together, large ones in pieces: servers refuse messages above 4 MiB. Nothing is trusted: what comes
//! is cut off at the length that was promised, and whoever asked compares the hash.

use std::sync::atomic::{AtomicU64, Ordering};

use bazel_remote_apis::build::bazel::remote::execution::v2 as re;
use bazel_remote_apis::google::bytestream::byte_stream_client::ByteStreamClient;
use bazel_remote_apis::google::bytestream::{ReadRequest, WriteRequest};
use re::batch_update_blobs_request::Request as Upload;
use re::content_addressable_storage_client::ContentAddressableStorageClient;
use sha2::{Digest as _, Sha256};
use tonic::codegen::tokio_stream;

use super::link::{Trouble, Wire};
use super::messages::Blob;

/// Blobs of at most so many bytes travel together.
const SMALL: usize = 1 << 20;
/// So many bytes at most in one message, if the server does not want fewer.
const BATCH: usize = 3 << 20;
/// Bytes of one piece of a large blob.
const PIECE: usize = 1 << 20;
/// What the names of a blob take in a message beside its bytes, generously.
const OVERHEAD: usize = 128;
/// Space is taken for so many bytes before they are there.
const AT_ONCE: usize = 4 << 20;

/// A server's storage.
#[derive(Clone)]
pub struct Store {
    pub wire: Wire,
    pub instance: String,
    /// So many bytes at most in one message, by the server's own word; 0: it has none.
    pub batch: usize,
}

impl Store {
    /// Uploads what the server does not have, and returns how many bytes that was.
    pub async fn upload(&self, blobs: Vec<Blob>) -> Result<u64, Trouble> {
        let mut cas = ContentAddressableStorageClient::new(self.wire.clone());
        let blob_digests = blobs.iter().map(|blob| blob.name.clone()).collect();
        let request =
            re::FindMissingBlobsRequest { instance_name: self.instance.clone(), blob_digests, ..Default::default() };
        let mut missing = cas.find_missing_blobs(request).await?.into_inner().missing_blob_digests;
        missing.sort_unstable_by(|a, b| a.hash.cmp(&b.hash));
        missing.dedup();
        let most = if self.batch == 0 { BATCH } else { BATCH.min(self.batch) };
        let (mut together, mut sum, mut sent) = (Vec::new(), 0, 0);
        for blob in blobs {
            let Ok(index) = missing.binary_search_by(|name| name.hash.cmp(&blob.name.hash)) else { continue };
            missing.remove(index);
            sent += blob.bytes.len() as u64;
            if blob.bytes.len() > SMALL.min(most) {
                self.write(blob).await?;
                continue;
            }
            let size = blob.bytes.len() + OVERHEAD;
            if sum + size > most {
                self.update(std::mem::take(&mut together)).await?;
                sum = 0;
            }
            sum += size;
            together.push(Upload { digest: Some(blob.name), data: blob.bytes.to_vec(), compressor: 0 });
        }
        if !together.is_empty() {
            self.update(together).await?;
        }
        Ok(sent)
    }

    async fn update(&self, requests: Vec<Upload>) -> Result<(), Trouble> {
        let mut cas = ContentAddressableStorageClient::new(self.wire.clone());
        let request =
            re::BatchUpdateBlobsRequest { instance_name: self.instance.clone(), requests, ..Default::default() };
        for response in cas.batch_update_blobs(request).await?.into_inner().responses {
            check(response.status)?;
        }
        Ok(())
    }

    async fn write(&self, blob: Blob) -> Result<(), Trouble> {
        let path = format!("uploads/{}/blobs/{}/{}", unique(), blob.name.hash, blob.name.size_bytes);
        let (path, size) = (self.resource(path), blob.name.size_bytes);
        let pieces = blob.bytes.len().div_ceil(PIECE);
        let piece = move |index: usize| {
            let range = index * PIECE..((index + 1) * PIECE).min(blob.bytes.len());
            WriteRequest {
                // The first says it for all.
                resource_name: if index == 0 { path.clone() } else { String::new() },
                write_offset: range.start as i64,
                finish_write: range.end == blob.bytes.len(),
                data: blob.bytes[range].to_vec(),
            }
        };
        let written =
            ByteStreamClient::new(self.wire.clone()).write(tokio_stream::iter((0..pieces).map(piece))).await?;
        match written.into_inner().committed_size {
            all if all == size => Ok(()),
            part => Err(Trouble::Lost(format!("it took {part} of {size} bytes"))),
        }
    }

    /// The bytes of a blob, as many as its name says; the caller compares the hash.
    pub async fn read(&self, name: re::Digest) -> Result<Vec<u8>, Trouble> {
        let size = usize::try_from(name.size_bytes).map_err(|_| Trouble::Wrong("a negative length".to_string()))?;
        let resource_name = self.resource(format!("blobs/{}/{size}", name.hash));
        let request = ReadRequest { resource_name, ..ReadRequest::default() };
        let mut stream = ByteStreamClient::new(self.wire.clone()).read(request).await?.into_inner();
        let mut bytes = Vec::with_capacity(size.min(AT_ONCE));
        while let Some(piece) = stream.message().await? {
            if piece.data.len() > size - bytes.len() {
                return Err(Trouble::Wrong(format!("it sent more than the {size} bytes of a blob")));
            }
            bytes.extend_from_slice(&piece.data);
        }
        match bytes.len() {
            all if all == size => Ok(bytes),
            part => Err(Trouble::Wrong(format!("it sent {part} of the {size} bytes of a blob"))),
        }
    }

    fn resource(&self, path: String) -> String {
        if self.instance.is_empty() { path } else { format!("{}/{path}", self.instance) }
    }
}

/// A status inside of an answer.
pub fn check(status: Option<bazel_remote_apis::google::rpc::Status>) -> Result<(), Trouble> {
    match status {
        Some(status) if status.code != 0 => {
            Err(tonic::Status::new(tonic::Code::from_i32(status.code), status.message).into())
        }
        _ => Ok(()),
    }
}

/// A name that no other upload has.
fn unique() -> String {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let time = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    let told = (std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed), time.as_nanos());
    let hex: String = Sha256::digest(format!("{told:?}")).iter().map(|byte| format!("{byte:02x}")).collect();
    [&hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..32]].join("-")
}
