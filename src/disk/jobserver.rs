//! GNU make's jobserver, as a client: a make that runs kiln lends it threads.
//!
//! Source: GNU make's manual, "POSIX Jobserver Interaction". `MAKEFLAGS` names a pipe, by its descriptors (`R,W`, make
//! before 4.4) or by its path (`fifo:PATH`); a byte in it is the right to one job more than the first, and must be put
//! back. Descriptors are opened anew by their names in `/dev/fd`, so that asking need not wait and nobody else's reads
//! are disturbed.
//!
//! Unaware of: what is done with the rights.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::sync::{Mutex, PoisonError};

/// A make that lends threads. When it is dropped, all that was taken goes back.
#[derive(Debug)]
pub struct Jobserver {
    pipe: File,
    taken: Mutex<Vec<u8>>,
}

impl Jobserver {
    /// The jobserver that `makeflags` (the value of `MAKEFLAGS`) names; `None` if it names none, or one that cannot be
    /// reached: make closes the pipe to commands that it does not take for makes, which are those without a `+`.
    pub fn from_makeflags(makeflags: &str) -> Option<Self> {
        let named = |word: &'_ str| {
            let flags = ["--jobserver-auth=", "--jobserver-fds="];
            flags.iter().find_map(|flag| word.strip_prefix(flag)).map(str::to_string)
        };
        // Variables after ` -- ` may hold anything; the last of several wins.
        let flags = makeflags.split(" -- ").next().unwrap_or("");
        let auth = flags.split_ascii_whitespace().filter_map(named).next_back()?;
        let path = match auth.strip_prefix("fifo:") {
            Some(path) => path.to_string(),
            None => {
                let (read, _) = auth.split_once(',')?;
                format!("/dev/fd/{}", read.parse::<u32>().ok()?)
            }
        };
        let pipe = open(&path).ok()?;
        Some(Jobserver { pipe, taken: Mutex::default() })
    }

    /// Takes one right, if there is one now.
    pub fn take(&self) -> bool {
        let mut byte = [0];
        let got = matches!((&self.pipe).read(&mut byte), Ok(1));
        if got {
            self.taken.lock().unwrap_or_else(PoisonError::into_inner).push(byte[0]);
        }
        got
    }

    /// Puts everything back that was taken.
    pub fn give_back(&self) {
        let taken = std::mem::take(&mut *self.taken.lock().unwrap_or_else(PoisonError::into_inner));
        // If the pipe is gone, so is the make that would want it.
        let _ = (&self.pipe).write_all(&taken);
    }
}

impl Drop for Jobserver {
    fn drop(&mut self) {
        self.give_back();
    }
}

/// Opens a pipe for both reading and writing, so that neither waits for somebody at the other end.
#[cfg(target_os = "linux")]
fn open(path: &str) -> io::Result<File> {
    use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
    /// `O_NONBLOCK`: reading from an empty pipe fails at once. The same on every Linux that Rust's tier 1 knows.
    const NON_BLOCKING: i32 = 0o4000;
    let file = OpenOptions::new().read(true).write(true).custom_flags(NON_BLOCKING).open(path)?;
    if file.metadata()?.file_type().is_fifo() { Ok(file) } else { Err(io::ErrorKind::InvalidInput.into()) }
}

/// Elsewhere `/dev/fd` shares one description with make, which must stay as it is: no threads are lent.
#[cfg(not(target_os = "linux"))]
fn open(_: &str) -> io::Result<File> {
    Err(io::ErrorKind::Unsupported.into())
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use std::os::fd::AsRawFd;

    #[test]
    fn rights_are_taken_one_by_one_and_all_go_back() {
        let (mut read, mut write) = io::pipe().unwrap();
        write.write_all(b"++").unwrap();
        let flags =
            format!("rk -j3 --jobserver-auth={},{} -- --jobserver-auth=8,9", read.as_raw_fd(), write.as_raw_fd());
        let server = Jobserver::from_makeflags(&flags).unwrap();
        assert_eq!([server.take(), server.take(), server.take()], [true, true, false]);
        drop(server);
        let mut back = [0; 2];
        read.read_exact(&mut back).unwrap();
        assert_eq!(&back, b"++");
    }

    #[test]
    fn what_names_no_pipe_is_no_jobserver() {
        for flags in ["", "rk", "--jobserver-auth=", "--jobserver-auth=a,b", "--jobserver-auth=fifo:/dev/null"] {
            assert!(Jobserver::from_makeflags(flags).is_none(), "{flags}");
        }
        assert!(Jobserver::from_makeflags("--jobserver-auth=-1,-1").is_none());
    }
}
