//! Unpacks the engine in its page: LZMA, which browsers cannot read, makes it 40 % smaller than what they can.
//!
//! Its doors are called like those of the engine: who calls asks for room with `sinew_room`, writes there, and calls
//! `sinew_unpack`. What that answers lies at `sinew_answer`: what was packed, or, where it returned not 0, the text of the
//! error. No address of a caller is ever read, so there is no `unsafe` here but the names of exports.
#![deny(unsafe_code)]

use lzma_rust2::{Error, LzmaReader, Read};
use std::cell::RefCell;

thread_local! {
    static ROOM: RefCell<Vec<u8>> = RefCell::default();
    static ANSWER: RefCell<Vec<u8>> = RefCell::default();
}

/// Address of room for so many bytes, which `sinew_unpack` reads.
#[allow(unsafe_code, reason = "the name of an export")]
#[unsafe(no_mangle)]
pub extern "C" fn sinew_room(bytes: usize) -> *mut u8 {
    ROOM.with_borrow_mut(|room| {
        room.resize(bytes, 0);
        room.as_mut_ptr()
    })
}

/// Address of the answer.
#[allow(unsafe_code, reason = "the name of an export")]
#[unsafe(no_mangle)]
pub extern "C" fn sinew_answer() -> *const u8 {
    ANSWER.with_borrow(|answer| answer.as_ptr())
}

/// Bytes of the answer.
#[allow(unsafe_code, reason = "the name of an export")]
#[unsafe(no_mangle)]
pub extern "C" fn sinew_answer_length() -> usize {
    ANSWER.with_borrow(Vec::len)
}

/// Answers what is in room, unpacked; room is empty then.
#[allow(unsafe_code, reason = "the name of an export")]
#[unsafe(no_mangle)]
pub extern "C" fn sinew_unpack() -> i32 {
    let (code, answer) = match unpack(&ROOM.take()) {
        Ok(bytes) => (0, bytes),
        Err(Error::OutOfMemory(_)) => (1, b"there is no memory to unpack the engine".to_vec()),
        Err(_) => (1, b"the engine in this page is damaged: get the page again".to_vec()),
    };
    ANSWER.set(answer);
    code
}

/// Memory (KiB) that a pack may ask for: those of build.sh want 16 MiB.
const MOST_MEMORY: u32 = 64 << 10;

/// A file as `xz --format=lzma` writes it. It has no checksum: after a wrong bit all others mean something else, which does not
/// end where the file does.
fn unpack(packed: &[u8]) -> Result<Vec<u8>, Error> {
    let mut reader = LzmaReader::new_mem_limit(packed, MOST_MEMORY, None)?;
    let (mut bytes, mut part) = (Vec::new(), vec![0; 1 << 16]);
    loop {
        match reader.read(&mut part)? {
            0 => return Ok(bytes),
            count => bytes.extend_from_slice(&part[..count]),
        }
    }
}
