//! Which files a scene is made of, so that nobody writes over them.

use std::collections::BTreeSet;
use std::convert::Infallible;
use std::path::{Path, PathBuf};

use gltf::json;

use crate::assemble::SceneRequest;
use crate::gltf::GltfScene;
use crate::json::Document;
use crate::spec::volume_spec::VolumeSpec;
use crate::uri::resolve_uri;
use crate::volume::VolumeLoader;

/// The files that the buffers and images of a glTF file are in, needed or not; URIs that mean no
/// file are left out.
pub(crate) fn of_gltf(document: &Document, root: &json::Root) -> Vec<PathBuf> {
    let folder = document.path().parent().unwrap_or(Path::new(""));
    let buffers = root.buffers.iter().filter_map(|buffer| buffer.uri.as_deref());
    let images = root.images.iter().filter_map(|image| image.uri.as_deref());
    // Places are for messages, which nobody sees here.
    buffers
        .chain(images)
        .filter(|uri| !uri.starts_with("data:"))
        .filter_map(|uri| resolve_uri(folder, uri, &Default::default()).ok())
        .collect()
}

/// All files of a loaded scene, each once, in the order of their names.
pub(crate) fn of_scene(
    request: &SceneRequest<'_>,
    file: Option<&GltfScene>,
    loader: &VolumeLoader,
) -> Vec<PathBuf> {
    let mut files: BTreeSet<PathBuf> = loader.files().map(Path::to_owned).collect();
    files.extend(request.gltf.iter().map(|(path, _)| path.clone()));
    let own = request.volumes.iter();
    files.extend(own.flat_map(tables));
    if let Some(file) = file {
        files.extend(file.files.iter().cloned());
        files.extend(file.volumes.iter().flat_map(|volume| tables(&volume.spec)));
    }
    files.into_iter().collect()
}

/// The files of a volume but for that of its grids, whose name may stand for a frame.
fn tables(spec: &VolumeSpec) -> Vec<PathBuf> {
    let mut tables = Vec::new();
    let collect = |key: &str, name: &str| {
        if key != "/vdb" {
            tables.push(PathBuf::from(name));
        }
        Ok::<_, Infallible>(name.to_owned())
    };
    let Ok(()) = spec.clone().resolve_files(collect);
    tables
}
