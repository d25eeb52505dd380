//! What is said to servers, as messages of the Remote Execution API v2.
//!
//! A key of kiln is an `Action` whose command names it: the same key is the same action for every kiln. Its `ActionResult`
//! has the artefact as an output file, and as standard output a line with the BLAKE3 and what it cost. What a worker is to
//! do is another action, with kiln itself and all that the step reads as its input root.
//!
//! Unaware of: connections.

use std::collections::BTreeMap;

use bazel_remote_apis::build::bazel::remote::execution::v2 as re;
use bazel_remote_apis::google::protobuf;
use prost::Message;
use sha2::{Digest as _, Sha256};

use crate::build::{ARTEFACT, Bytes, Digest, INPUTS, ORDER, Record};

/// Name of kiln in the input root.
const PROGRAM: &str = "kiln";
/// Raised when results are written in another way.
const SALT: &[u8] = b"kiln artefact 1";
/// Longest line about an artefact.
const LINE_LIMIT: usize = 256;

/// Bytes under the name that servers know them by.
#[derive(Clone, Debug)]
pub struct Blob {
    pub name: re::Digest,
    pub bytes: Bytes,
}

impl Blob {
    pub fn new(bytes: Bytes) -> Self {
        Blob { name: name_of(&bytes), bytes }
    }

    fn message(message: &impl Message) -> Self {
        Blob::new(message.encode_to_vec().into())
    }
}

/// An action, and the blobs that make it, itself first.
#[derive(Debug)]
pub struct Action {
    pub name: re::Digest,
    pub blobs: Vec<Blob>,
}

impl Action {
    fn new(command: &re::Command, root: Vec<Blob>, rest: re::Action) -> Self {
        let command = Blob::message(command);
        let (command_digest, input_root_digest) = (Some(command.name.clone()), root.first().map(|b| b.name.clone()));
        let action = Blob::message(&re::Action { command_digest, input_root_digest, ..rest });
        Action { name: action.name.clone(), blobs: [vec![action, command], root].concat() }
    }
}

/// The name of these bytes: their SHA-256 and length.
pub fn name_of(bytes: &[u8]) -> re::Digest {
    let hash = Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect();
    re::Digest { hash, size_bytes: bytes.len() as i64 }
}

/// What a key is called.
pub fn cached(key: &Digest) -> Action {
    let command = re::Command {
        arguments: [PROGRAM, "step", &key.to_string()].map(str::to_string).to_vec(),
        output_paths: vec![ARTEFACT.to_string()],
        ..re::Command::default()
    };
    let root = vec![Blob::message(&re::Directory::default())];
    Action::new(&command, root, re::Action { salt: SALT.to_vec(), ..re::Action::default() })
}

/// What a key gave.
pub fn result(record: &Record, artefact: re::Digest) -> re::ActionResult {
    let file = re::OutputFile { path: ARTEFACT.to_string(), digest: Some(artefact), ..re::OutputFile::default() };
    let line = format!("blake3 {} {}\n", record.artefact, record.wall_ms);
    re::ActionResult { output_files: vec![file], stdout_raw: line.into_bytes(), ..re::ActionResult::default() }
}

/// The artefact of a result: its name, if it is a name and the length can be one.
pub fn artefact(result: &re::ActionResult) -> Option<re::Digest> {
    let file = result.output_files.iter().find(|file| file.path == ARTEFACT)?;
    let name = file.digest.clone()?;
    let hex = name.hash.len() == 64 && name.hash.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b));
    (hex && name.size_bytes >= 0).then_some(name)
}

/// What a result says of a key, in kiln's words.
pub fn record(result: &re::ActionResult) -> Option<(Record, re::Digest)> {
    let name = artefact(result).filter(|_| result.exit_code == 0)?;
    let line = std::str::from_utf8(result.stdout_raw.get(..LINE_LIMIT.min(result.stdout_raw.len()))?).ok()?;
    let mut words = line.split_ascii_whitespace();
    let (Some("blake3"), Some(hex), Some(wall_ms), None) = (words.next(), words.next(), words.next(), words.next())
    else {
        return None;
    };
    let record =
        Record { artefact: Digest::from_hex(hex)?, len: name.size_bytes as u64, wall_ms: wall_ms.parse().ok()? };
    Some((record, name))
}

/// Whether this may be the name of a line about an artefact.
pub fn is_line(name: &re::Digest) -> bool {
    (1..=LINE_LIMIT as i64).contains(&name.size_bytes)
}

/// What a worker needs.
pub struct Work {
    /// The program that is to run there.
    pub program: Blob,
    /// What it is to do.
    pub order: Bytes,
    /// What the step reads.
    pub inputs: Vec<Bytes>,
    /// What kind of machine it has to be.
    pub platform: BTreeMap<String, String>,
    /// How long it may take, in seconds.
    pub seconds: u64,
}

/// What a worker is to do: `kiln step KEY` where its inputs are.
pub fn work(key: &Digest, work: Work) -> Action {
    let Work { program, order, inputs, platform, seconds } = work;
    let property = |(name, value): (String, String)| re::platform::Property { name, value };
    let platform =
        (!platform.is_empty()).then(|| re::Platform { properties: platform.into_iter().map(property).collect() });
    let node = |name: String, blob: &Blob, is_executable| re::FileNode {
        name,
        digest: Some(blob.name.clone()),
        is_executable,
        ..re::FileNode::default()
    };
    let (order, inputs): (Blob, Vec<Blob>) = (Blob::new(order), inputs.into_iter().map(Blob::new).collect());
    // In the order of their names, as everything in a folder has to be.
    let folder = re::Directory {
        files: inputs.iter().enumerate().map(|(index, blob)| node(input_name(index), blob, false)).collect(),
        ..re::Directory::default()
    };
    let folder = Blob::message(&folder);
    let root = re::Directory {
        files: vec![node(PROGRAM.to_string(), &program, true), node(ORDER.to_string(), &order, false)],
        directories: vec![re::DirectoryNode { name: INPUTS.to_string(), digest: Some(folder.name.clone()) }],
        ..re::Directory::default()
    };
    #[expect(deprecated, reason = "servers before version 2.2 look here and not into the action")]
    let command = re::Command {
        arguments: [&format!("./{PROGRAM}"), "step", &key.to_string()].map(str::to_string).to_vec(),
        output_paths: vec![ARTEFACT.to_string()],
        platform: platform.clone(),
        ..re::Command::default()
    };
    let timeout = Some(protobuf::Duration { seconds: seconds as i64, nanos: 0 });
    let root = [vec![Blob::message(&root), folder, order, program], inputs].concat();
    Action::new(&command, root, re::Action { timeout, platform, ..re::Action::default() })
}

/// Name of input `index` in its folder.
fn input_name(index: usize) -> String {
    format!("{index:06}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_the_same_action_for_every_kiln() {
        let action = cached(&Digest::from_bytes([7; 32]));
        assert_eq!(action.blobs.len(), 3, "action, command, empty folder");
        assert_eq!(action.blobs[2].name.hash, "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
        let again = cached(&Digest::from_bytes([7; 32]));
        assert_eq!(action.name, again.name);
        assert_ne!(action.name, cached(&Digest::from_bytes([8; 32])).name);
        // If this changes, all that servers keep is lost: raise `SALT` on purpose instead.
        assert_eq!(action.name.hash, "845cfb8f035d5d13ed22d3c339f49376468949b370b05372b7d69f22a293df74");
    }

    #[test]
    fn results_come_back_as_they_were_and_nonsense_does_not() {
        let record_in = Record { artefact: Digest::of(b"moss"), len: 4, wall_ms: 12 };
        let sound = result(&record_in, name_of(b"moss"));
        assert_eq!(record(&sound), Some((record_in, name_of(b"moss"))));
        let spoil = |spoil: &dyn Fn(&mut re::ActionResult)| {
            let mut result = sound.clone();
            spoil(&mut result);
            record(&result)
        };
        assert_eq!(spoil(&|r| r.exit_code = 1), None);
        assert_eq!(spoil(&|r| r.output_files.clear()), None);
        assert_eq!(spoil(&|r| r.output_files[0].digest = None), None);
        let digest = |edit: &dyn Fn(&mut re::Digest)| spoil(&|r| r.output_files[0].digest.iter_mut().for_each(edit));
        assert_eq!(digest(&|d| d.size_bytes = -1), None);
        assert_eq!(digest(&|d| d.hash = "../../etc/passwd".to_string()), None);
        assert_eq!(spoil(&|r| r.stdout_raw = b"blake3 xyz 12".to_vec()), None);
        assert_eq!(spoil(&|r| r.stdout_raw.extend(b"more")), None);
        assert_eq!(spoil(&|r| r.stdout_raw = vec![b'1'; 1 << 20]), None);
        assert_eq!(spoil(&|r| r.stdout_raw.clear()), None);
    }

    #[test]
    #[expect(deprecated, reason = "the platform is looked at where old servers do")]
    fn folders_are_in_the_order_of_their_names() {
        let inputs = (0..12u8).map(|n| Bytes::from(vec![n])).collect();
        let program = Blob::new(b"program".to_vec().into());
        let platform = [("OSFamily", "linux"), ("ISA", "x86-64")].map(|(n, v)| (n.to_string(), v.to_string()));
        let order = Bytes::from(b"{}".to_vec());
        let action = work(&Digest::of(b"key"), Work { program, order, inputs, platform: platform.into(), seconds: 9 });
        assert_eq!(action.blobs.len(), 2 + 4 + 12);
        let folder = re::Directory::decode(&*action.blobs[3].bytes).unwrap();
        let names: Vec<&str> = folder.files.iter().map(|file| file.name.as_str()).collect();
        assert!(names.is_sorted() && names.len() == 12);
        let root = re::Directory::decode(&*action.blobs[2].bytes).unwrap();
        assert!(root.files[0].is_executable && !root.files[1].is_executable);
        let command = re::Command::decode(&*action.blobs[1].bytes).unwrap();
        let properties: Vec<String> = command.platform.unwrap().properties.into_iter().map(|p| p.name).collect();
        assert_eq!(properties, ["ISA", "OSFamily"], "sorted, as the API wants them");
    }
}
