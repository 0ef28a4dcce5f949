//! Where files that a scene names come from.

use sinew::engine::memory::read_file;
use std::collections::HashMap;
use std::io;
use std::path::PathBuf;

/// Answers for files that a scene names: a folder, memory, an archive, whatever the host has.
pub trait Files: Send + Sync {
    /// Bytes of a file, by the path in the scene. [`NotFound`](io::ErrorKind::NotFound) where there is none.
    ///
    /// # Errors
    /// When it cannot be read.
    fn read(&self, path: &str) -> io::Result<Vec<u8>>;
}

impl<F: Fn(&str) -> io::Result<Vec<u8>> + Send + Sync> Files for F {
    fn read(&self, path: &str) -> io::Result<Vec<u8>> {
        self(path)
    }
}

/// Files in memory by their paths.
impl Files for HashMap<String, Vec<u8>> {
    fn read(&self, path: &str) -> io::Result<Vec<u8>> {
        self.get(path).cloned().ok_or_else(|| {
            let known: Vec<&str> = self.keys().map(String::as_str).collect();
            let text = match known.is_empty() {
                true => format!("no file `{path}` was given"),
                false => format!("no file `{path}` among those given ({})", known.join(", ")),
            };
            io::Error::new(io::ErrorKind::NotFound, text)
        })
    }
}

/// A folder of the file system.
#[derive(Clone, Debug)]
pub struct Folder(pub PathBuf);

impl Files for Folder {
    fn read(&self, path: &str) -> io::Result<Vec<u8>> {
        read_file(&self.0.join(path))
    }
}
