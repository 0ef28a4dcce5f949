//! Disjoint sets of numbers that are joined (union-find).

/// The numbers from 0 on, each in one set; the lowest number of a set stands for it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DisjointSets(Vec<u32>);

impl DisjointSets {
    /// `n` sets of one number each.
    pub fn new(n: usize) -> Self {
        Self((0..n as u32).collect())
    }

    /// The number that stands for the set of `i`.
    pub fn root(&mut self, mut i: u32) -> u32 {
        let Self(parent) = self;
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }

    /// Makes one set of those of two numbers; whether there were two.
    pub fn join(&mut self, a: u32, b: u32) -> bool {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
        a != b
    }

    /// Makes a number a set of its own; all others of its set have to follow.
    pub fn release(&mut self, i: u32) {
        self.0[i as usize] = i;
    }

    /// The sets counted in the order of their lowest numbers: that of every number.
    pub fn count(&mut self) -> Vec<u32> {
        let mut place = vec![u32::MAX; self.0.len()];
        let mut sets = 0;
        (0..self.0.len() as u32)
            .map(|i| {
                let root = self.root(i) as usize;
                if place[root] == u32::MAX {
                    place[root] = sets;
                    sets += 1;
                }
                place[root]
            })
            .collect()
    }
}
