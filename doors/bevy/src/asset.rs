//! Meshes of bodies as assets.

use bevy_app::App;
use bevy_asset::io::Reader;
use bevy_asset::{Asset, AssetApp, AssetLoader, AssetServer, LoadContext};
use bevy_reflect::TypePath;
use sinew::engine::mesh::{CheckError, CheckOptions, Mesh, MeshError, check};
use std::sync::Arc;

/// Extensions of mesh files of one piece that the loader takes.
pub const MESH_EXTENSIONS: &[&str] = &["msh", "vtk", "vtu", "obj", "stl"];

/// A mesh that was found fit to be simulated; inverted cells are turned round. Lengths are in metres, or are made
/// metres by the `Transform` of the body.
#[derive(Asset, TypePath, Clone, Debug)]
pub struct SoftMesh {
    mesh: Arc<Mesh>,
}

/// A mesh that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SoftMeshError {
    /// The file could not be read.
    #[error("{path}: {source}")]
    Io {
        /// Path of the asset.
        path: String,
        /// Cause.
        source: std::io::Error,
    },
    /// The bytes are no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The mesh cannot be simulated.
    #[error(transparent)]
    Check(#[from] CheckError),
    /// There is no such group of vertices.
    #[error("{mesh} has no group `{group}`; it has {}", known.join(", "))]
    Group {
        /// Mesh.
        mesh: String,
        /// Group asked for.
        group: String,
        /// Groups that exist.
        known: Vec<String>,
    },
}

impl SoftMesh {
    /// Checks a mesh. That it is small or large is no finding: the `Transform` of a body may scale it.
    ///
    /// # Errors
    /// When the mesh cannot be simulated; the text lists every error.
    pub fn new(mesh: Mesh) -> Result<Self, SoftMeshError> {
        let options = CheckOptions { expected_size: None, ..Default::default() };
        Ok(Self { mesh: Arc::new(check(&mesh, &options)?.mesh) })
    }

    /// Reads and checks the bytes of a mesh file; see [`Mesh::from_bytes`].
    ///
    /// # Errors
    /// When they are no mesh, or one that cannot be simulated.
    pub fn from_bytes(name: &str, bytes: &[u8]) -> Result<Self, SoftMeshError> {
        Self::new(Mesh::from_bytes(name, bytes)?)
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The mesh, shared.
    pub(crate) fn shared(&self) -> Arc<Mesh> {
        self.mesh.clone()
    }

    /// Vertices of a named group, for [`SinewHold`](crate::SinewHold) and [`SinewPull`](crate::SinewPull).
    ///
    /// # Errors
    /// When the mesh has no such group; the text names those it has.
    pub fn group(&self, group: &str) -> Result<Vec<u32>, SoftMeshError> {
        match self.mesh.group(group) {
            Some(found) => Ok(found.vertices.clone()),
            None => Err(SoftMeshError::Group {
                mesh: self.mesh.source.clone(),
                group: group.into(),
                known: self.mesh.groups.iter().map(|g| format!("`{}`", g.name)).collect(),
            }),
        }
    }
}

/// Loads a [`SoftMesh`] from the formats that Sinew reads; TetGen's, which takes two files, is for
/// [`Mesh::read`](sinew::prelude::Mesh::read) and [`SoftMesh::new`].
#[derive(TypePath, Default)]
pub struct SoftMeshLoader;

impl AssetLoader for SoftMeshLoader {
    type Asset = SoftMesh;
    type Settings = ();
    type Error = SoftMeshError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        _settings: &(),
        context: &mut LoadContext<'_>,
    ) -> Result<SoftMesh, SoftMeshError> {
        let path = context.path().to_string();
        let mut bytes = Vec::new();
        match reader.read_to_end(&mut bytes).await {
            Ok(_) => SoftMesh::from_bytes(&path, &bytes),
            Err(source) => Err(SoftMeshError::Io { path, source }),
        }
    }

    fn extensions(&self) -> &[&str] {
        MESH_EXTENSIONS
    }
}

pub(crate) fn build(app: &mut App) {
    assert!(
        app.world().contains_resource::<AssetServer>(),
        "`SinewBevyPlugins` needs `AssetPlugin`: add `DefaultPlugins` (or `AssetPlugin`) before it"
    );
    app.init_asset::<SoftMesh>().register_asset_loader(SoftMeshLoader);
}
