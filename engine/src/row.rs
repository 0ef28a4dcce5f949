//! Numbers of vertices, each a type of its own, so that one is never taken for another: [`MeshVertex`] in the mesh
//! that the user gave, [`LocalRow`] in the engine's order of one body, [`VertexRow`] in the table of all bodies.
//! [`BodyRows`](crate::topology::BodyRows) leads from one to another.
//!
//! Bare numbers are left in two places: a [`Mesh`](crate::mesh::Mesh) is plain data, so that numbers in its lists are
//! vertices of it and turn into [`MeshVertex`] by themselves; kernels, columns of elements and edges hold rows.

use bevy_ecs::prelude::Component;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::marker::PhantomData;
use std::ops::{Index, IndexMut};

macro_rules! numbers {
    ($($(#[$doc:meta])* $name:ident),+ $(,)?) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        #[repr(transparent)]
        pub struct $name(pub u32);

        impl $name {
            /// Place in a list of all.
            #[inline(always)]
            pub fn index(self) -> usize {
                self.0 as usize
            }
        }

        impl From<$name> for usize {
            #[inline(always)]
            fn from(number: $name) -> Self {
                number.index()
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.fmt(f)
            }
        }
    )+};
}

numbers! {
    /// Row of the vertex table, where a vertex of any body has its columns. Constraints, loads, pressures and pulls
    /// name these.
    VertexRow,
    /// Row of a vertex, counted from the first row of its body.
    LocalRow,
    /// Vertex of the mesh that the user gave, on its entity too.
    #[derive(Component)]
    #[component(clone_behavior = Ignore)]
    MeshVertex,
}

impl From<u32> for MeshVertex {
    fn from(number: u32) -> Self {
        Self(number)
    }
}

/// A list with an entry for each of what `I` counts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IndexVec<I, T> {
    entries: Vec<T>,
    of: PhantomData<fn(I)>,
}

impl<I, T> IndexVec<I, T> {
    /// Number of entries.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there is no entry.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The entry of `i`, `None` beyond the end.
    pub fn get(&self, i: I) -> Option<&T>
    where
        I: Into<usize>,
    {
        self.entries.get(i.into())
    }

    /// The entries in order.
    pub fn iter(&self) -> std::slice::Iter<'_, T> {
        self.entries.iter()
    }
}

impl<I, T> Default for IndexVec<I, T> {
    fn default() -> Self {
        Vec::new().into()
    }
}

impl<I, T> From<Vec<T>> for IndexVec<I, T> {
    fn from(entries: Vec<T>) -> Self {
        Self { entries, of: PhantomData }
    }
}

impl<I, T> FromIterator<T> for IndexVec<I, T> {
    fn from_iter<E: IntoIterator<Item = T>>(entries: E) -> Self {
        Vec::from_iter(entries).into()
    }
}

impl<'a, I, T> IntoIterator for &'a IndexVec<I, T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;
    fn into_iter(self) -> Self::IntoIter {
        self.entries.iter()
    }
}

impl<I: Into<usize>, T> Index<I> for IndexVec<I, T> {
    type Output = T;
    #[inline(always)]
    fn index(&self, i: I) -> &T {
        &self.entries[i.into()]
    }
}

impl<I: Into<usize>, T> IndexMut<I> for IndexVec<I, T> {
    #[inline(always)]
    fn index_mut(&mut self, i: I) -> &mut T {
        &mut self.entries[i.into()]
    }
}
