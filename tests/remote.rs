//! A server of the Remote Execution API beside kiln: what one machine made another takes, workers do steps, and whatever the
//! server does - nothing, slowly, wrongly, dying - outputs are right and the bake ends.
//!
//! Most of it talks to a server in this file that can be told to misbehave. Where `KILN_BUILDBOX` names a folder with
//! buildbox, a real one is used as well; `tests/slow/remote.sh` installs it.
#![cfg(unix)]

mod common;
mod remote_server;

use std::collections::BTreeMap;
use std::io::Read;
use std::net::TcpListener;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use common::{Project, Ran, small_project};
use remote_server::{Fault, Server};

type Contents = BTreeMap<String, Vec<u8>>;

/// A canvas whose artefacts are too large to travel together with others.
const LARGE: &str = "[canvas]\nsize = [640, 640]\n[exemplar]\nbase_color = 'e.png'\n[analysis]\nneighbourhoods = [3]\n[synthesis]\nrefine = 0\n";

/// Two small recipes and a large one, with these lines in `[cache]` of kiln.toml.
fn project(settings: &str) -> Project {
    let project = small_project(2);
    project.write("recipes/large.toml", LARGE);
    project.write("kiln.toml", format!("[cache]\n{settings}\n"));
    project
}

/// What a bake without others makes.
fn reference() -> &'static Contents {
    static REFERENCE: std::sync::OnceLock<Contents> = std::sync::OnceLock::new();
    REFERENCE.get_or_init(|| {
        let project = project("");
        project.kiln(&["bake", "-q"]).expect(0);
        project.contents("out")
    })
}

/// A bake of all, which ends well.
fn bake(project: &Project, args: &[&str]) -> (Ran, Duration) {
    let begun = Instant::now();
    let ran = project.kiln(&[&["bake", "-j2"], args].concat()).expect(0);
    let elapsed = begun.elapsed();
    assert!(project.contents("out") == *reference(), "outputs are not what a bake without others makes:\n{}", ran.err);
    (ran, elapsed)
}

fn warnings(ran: &Ran) -> Vec<&str> {
    ran.err.lines().filter(|line| line.starts_with("warning:")).collect()
}

#[test]
fn what_one_machine_made_another_takes() {
    let server = Server::start(Fault::None);
    let first = project(&format!("remote = '{}'", server.url()));
    let (ran, _) = bake(&first, &[]);
    assert!(!ran.out.contains(" 0 steps run") && warnings(&ran).is_empty(), "{}{}", ran.out, ran.err);
    let seen = server.seen();
    assert!(seen.writes > 0 && seen.batches > 0 && seen.updates > 0, "{seen:?}");

    let second = project("");
    let (ran, _) = bake(&second, &["--remote", &server.url()]);
    assert!(ran.out.contains(" 0 steps run") && warnings(&ran).is_empty(), "{}{}", ran.out, ran.err);
    assert_eq!(server.seen().updates, seen.updates, "what was found is not stored again");

    // Nothing to do: nobody is asked, not even whether they are there.
    let before = server.seen().calls;
    assert!(second.kiln(&["bake", "--remote", &server.url()]).expect(0).out.starts_with("nothing to do"));
    let _ = std::fs::remove_file(second.path(".kiln/seal"));
    assert!(second.kiln(&["bake", "--remote", &server.url()]).expect(0).out.starts_with("nothing to do"));
    assert_eq!(server.seen().calls, before);

    // Outputs that are gone, in a cache that never had more than they.
    let _ = std::fs::remove_dir_all(second.path("out"));
    let _ = std::fs::remove_dir_all(second.path(".kiln/cache"));
    let (ran, _) = bake(&second, &["--remote", &server.url()]);
    assert!(ran.out.contains(" 0 steps run"), "{}{}", ran.out, ran.err);
}

#[test]
fn whoever_may_only_read_sends_nothing() {
    let server = Server::start(Fault::None);
    bake(&project("remote_mode = 'read'\nremote_execute = true"), &["--remote", &server.url()]);
    let seen = server.seen();
    assert_eq!((seen.writes, seen.batches, seen.updates, seen.executions), (0, 0, 0, 0), "{seen:?}");
    assert!(seen.lookups > 0);
    bake(&project(""), &["--remote", &server.url()]);
    let full = server.seen();
    let (ran, _) = bake(&project(""), &["--remote", &server.url(), "--remote-mode", "read"]);
    assert!(ran.out.contains(" 0 steps run"), "{}", ran.out);
    assert_eq!((server.seen().writes, server.seen().updates), (full.writes, full.updates));
}

#[test]
fn a_server_that_does_wrong_costs_time_and_nothing_else() {
    for fault in [
        Fault::WrongBytes,
        Fault::TooFew,
        Fault::TooMany,
        Fault::AbsentBlobs,
        Fault::FalseDigest,
        Fault::Oversized,
        Fault::Nonsense,
        Fault::HugeMessage,
        Fault::Stalls,
        Fault::Slow,
        Fault::Unavailable,
        Fault::RefusesWrites,
        Fault::OtherHash,
    ] {
        // Filled by somebody while it was well.
        let server = Server::start(Fault::None);
        if fault != Fault::RefusesWrites {
            bake(&project(""), &["--remote", &server.url()]);
        }
        server.set(fault);
        let here = project(&format!("remote = '{}'\nremote_timeout = 1", server.url()));
        let (ran, elapsed) = bake(&here, &[]);
        let said = warnings(&ran);
        println!("{fault:?}: {:.1} s, {said:?}", elapsed.as_secs_f64());
        // What is only not there is no fault of the server's.
        let quiet = matches!(fault, Fault::AbsentBlobs | Fault::Oversized | Fault::Nonsense);
        assert_eq!(said.len(), usize::from(!quiet), "{fault:?}: {}", ran.err);
        assert!(said.iter().all(|line| line.contains(&server.url())), "{fault:?}: {}", ran.err);
        assert!(elapsed < Duration::from_secs(60), "{fault:?}");
        server.set(Fault::None);
        assert!(here.kiln(&["bake"]).expect(0).out.starts_with("nothing to do"), "{fault:?}");
        here.kiln(&["cache", "verify"]).expect(0);
    }
}

#[test]
fn a_server_that_is_not_there_is_asked_once() {
    let nobody = TcpListener::bind("127.0.0.1:0").expect("a port");
    let refused = format!("grpc://{}", nobody.local_addr().expect("an address"));
    drop(nobody);
    // Takes connections and says nothing.
    let silent = TcpListener::bind("127.0.0.1:0").expect("a port");
    let silence = format!("grpc://{}", silent.local_addr().expect("an address"));
    for (url, most) in
        [(&*refused, 20), (&*silence, 30), ("grpc://no-such-host.invalid:1", 30), ("grpc://192.0.2.1:1", 30)]
    {
        let (ran, elapsed) = bake(&project("remote_timeout = 1"), &["--remote", url]);
        println!("{url}: {:.1} s, {:?}", elapsed.as_secs_f64(), warnings(&ran));
        assert_eq!(warnings(&ran).len(), 1, "{}", ran.err);
        assert!(warnings(&ran)[0].contains("going on without it"), "{}", ran.err);
        assert!(elapsed < Duration::from_secs(most), "{elapsed:?}");
    }
}

#[test]
fn steps_that_workers_do_not_do_are_done_here() {
    for fault in [Fault::NoWorkers, Fault::StatusOnly, Fault::NoOutputs, Fault::ExitCode, Fault::FalseOutput] {
        let server = Server::start(fault);
        let here = project(&format!("remote = '{}'\nremote_timeout = 2\nremote_execute = true", server.url()));
        let (ran, _) = bake(&here, &[]);
        let said = warnings(&ran);
        println!("{fault:?}: {said:?}");
        assert!((1..=3).contains(&said.len()), "{fault:?}: {}", ran.err);
        assert!(fault == Fault::NoWorkers || server.seen().executions > 0);
    }
}

/// buildbox-casd with its own workers.
struct Buildbox {
    process: Child,
    port: u16,
    folder: tempfile::TempDir,
}

impl Buildbox {
    /// `None` where there is none.
    fn start() -> Option<Self> {
        let Some(bin) = std::env::var_os("KILN_BUILDBOX").map(PathBuf::from) else {
            println!("skipped: KILN_BUILDBOX names no folder with buildbox");
            return None;
        };
        let folder = tempfile::tempdir().expect("a folder");
        let port = TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a port").port();
        let mut buildbox = Buildbox { process: Self::spawn(&bin, &folder, port), port, folder };
        let until = Instant::now() + Duration::from_secs(20);
        while std::net::TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(Instant::now() < until && buildbox.process.try_wait().expect("a child").is_none(), "no buildbox");
            std::thread::sleep(Duration::from_millis(20));
        }
        Some(buildbox)
    }

    fn spawn(bin: &std::path::Path, folder: &tempfile::TempDir, port: u16) -> Child {
        let mut command = Command::new(bin.join("buildbox-casd"));
        command.arg(format!("--bind=127.0.0.1:{port}")).arg("--jobs=2");
        command.arg(format!("--buildbox-run={}", bin.join("buildbox-run").display()));
        for at in ["/usr:/usr", "/usr/bin:/bin", "/usr/lib:/lib", "/usr/lib64:/lib64"] {
            command.arg(format!("--runner-arg=--ro-bind-mount={at}"));
        }
        command.arg(folder.path().join("cas")).stdout(Stdio::null()).stderr(Stdio::piped());
        command.spawn().expect("buildbox starts")
    }

    fn url(&self) -> String {
        format!("grpc://127.0.0.1:{}", self.port)
    }

    fn said(&mut self) -> String {
        let _ = self.process.kill();
        let mut text = String::new();
        let _ = self.process.stderr.take().map(|mut err| err.read_to_string(&mut text));
        text
    }
}

impl Drop for Buildbox {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
        let _ = self.folder.path();
    }
}

/// What kiln said of the server.
fn remote_line(ran: &Ran) -> &str {
    ran.err.lines().find(|line| line.starts_with("grpc://")).unwrap_or("")
}

#[test]
fn a_real_server_keeps_what_was_made() {
    let Some(server) = Buildbox::start() else { return };
    let (ran, alone) = bake(&project(""), &[]);
    assert_eq!(remote_line(&ran), "");
    let (ran, miss) = bake(&project(""), &["--remote", &server.url()]);
    println!("{}", remote_line(&ran));
    assert!(warnings(&ran).is_empty(), "{}", ran.err);
    let (ran, hit) = bake(&project(""), &["--remote", &server.url(), "--remote-mode", "read"]);
    println!("{}", remote_line(&ran));
    assert!(ran.out.contains(" 0 steps run") && warnings(&ran).is_empty(), "{}{}", ran.out, ran.err);
    println!("bake alone {alone:?}, with misses {miss:?}, with hits {hit:?}");
}

#[test]
fn a_real_server_does_steps() {
    let Some(mut server) = Buildbox::start() else { return };
    let begun = Instant::now();
    let here = project(&format!("remote = '{}'\nremote_execute = true", server.url()));
    let (ran, _) = bake(&here, &[]);
    println!("{} in {:?}", remote_line(&ran), begun.elapsed());
    assert!(warnings(&ran).is_empty(), "{}\n{}", ran.err, server.said());
    assert!(!remote_line(&ran).contains(" 0 done by workers"), "{}", ran.err);
    // Another machine that knows nothing, and asks for work: the server remembers both by key and by work.
    let begun = Instant::now();
    let (ran, _) = bake(&project("remote_execute = true"), &["--remote", &server.url()]);
    println!("{} in {:?}", remote_line(&ran), begun.elapsed());
    assert!(ran.out.contains(" 0 steps run"), "{}", ran.err);
}

#[test]
fn a_real_server_that_dies_during_a_bake_is_gone_on_without() {
    let mut cut = 0;
    for after_ms in [5, 40, 120, 300, 700] {
        for execute in ["", "remote_execute = true"] {
            let Some(mut server) = Buildbox::start() else { return };
            let here = project(&format!("remote = '{}'\nremote_timeout = 2\n{execute}", server.url()));
            let mut kiln = here.start(&["bake", "-j2"]);
            std::thread::sleep(Duration::from_millis(after_ms));
            let _ = server.process.kill();
            let begun = Instant::now();
            let status = kiln.wait().expect("a child");
            assert!(status.success() && begun.elapsed() < Duration::from_secs(60), "{status} {:?}", begun.elapsed());
            assert!(here.contents("out") == *reference(), "after {after_ms} ms");
            let mut said = String::new();
            let _ = kiln.stderr.take().map(|mut err| err.read_to_string(&mut said));
            cut += usize::from(said.contains("going on without it"));
            assert!(said.lines().filter(|line| line.starts_with("warning:")).count() <= 2, "{said}");
            here.kiln(&["cache", "verify"]).expect(0);
        }
    }
    println!("{cut} of 10 bakes noticed");
    assert!(cut > 0);
}
