//! Places of keys in scene files.

use sinew_scene::scene::LoadedScene;
use std::path::Path;

#[test]
fn lines_of_keys_are_found() {
    let text = "name = \"a\"\n\n[[body]]\nname = \"b\"\nmaterial = { preset = \"liver\" }\n\n\
                [[body]]\nname = \"c\"\n[body.material]\npreset = \"fat\"\n";
    let scene = LoadedScene::parse(text, Path::new("a.toml")).unwrap();
    assert_eq!(scene.place("name").line, Some(1));
    assert_eq!(scene.place("body[0].material.preset").line, Some(5));
    assert_eq!(scene.place("body[1].material.preset").line, Some(10));
    assert_eq!(scene.place("body[0].material.density").line, Some(5));
    assert_eq!(scene.place("nothing").line, None);
}
