//! Words that one thread writes and another one reads, always whole and always the last ones, without a lock and without
//! waiting.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};

/// Three copies of some words: one is written, one is read, and one waits. Whoever is done swaps his with the one that
/// waits, so that nobody ever waits for anybody.
#[derive(Debug)]
struct Slots {
    words: [Box<[AtomicU64]>; 3],
    /// Number of the copy that waits, and [`FRESH`] where it was not read yet.
    waiting: AtomicU8,
}

const FRESH: u8 = 4;

/// Gives words away.
#[derive(Debug)]
pub(crate) struct WordWriter {
    slots: Arc<Slots>,
    own: u8,
}

/// Has the words that were taken last.
#[derive(Debug)]
pub(crate) struct WordReader {
    slots: Arc<Slots>,
    own: u8,
}

/// Two ends for so many words, all zero at first.
pub(crate) fn word_slots(words: usize) -> (WordWriter, WordReader) {
    let empty = || (0..words).map(|_| AtomicU64::new(0)).collect();
    let slots = Slots { words: [empty(), empty(), empty()], waiting: AtomicU8::new(1) };
    let slots = Arc::new(slots);
    (WordWriter { slots: Arc::clone(&slots), own: 0 }, WordReader { slots, own: 2 })
}

impl WordWriter {
    /// Gives away what `fill` puts, word by word; what is beyond the number of words is dropped.
    pub fn write(&mut self, fill: impl FnOnce(&mut dyn FnMut(u64))) {
        let mut words = self.slots.words[usize::from(self.own)].iter();
        fill(&mut |bits| {
            if let Some(word) = words.next() {
                word.store(bits, Ordering::Relaxed);
            }
        });
        // all of it is there before whoever swaps it out looks at it
        let before = self.slots.waiting.swap(self.own | FRESH, Ordering::AcqRel);
        self.own = before & !FRESH;
    }

    /// Whether the other end is still there.
    pub fn is_read(&self) -> bool {
        Arc::strong_count(&self.slots) > 1
    }
}

impl WordReader {
    /// Takes the last words that were written; false where there are no new ones.
    pub fn update(&mut self) -> bool {
        if self.slots.waiting.load(Ordering::Relaxed) & FRESH == 0 {
            return false;
        }
        self.own = self.slots.waiting.swap(self.own, Ordering::AcqRel) & !FRESH;
        true
    }

    /// The words that were taken last.
    pub fn words(&self) -> impl Iterator<Item = u64> {
        let words = self.slots.words[usize::from(self.own)].iter();
        words.map(|word| word.load(Ordering::Relaxed))
    }
}
