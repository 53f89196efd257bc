//! What is read of glTF files, and which damage to them is an error.

use glam::{DVec3, Vec3};

use super::*;
use crate::light::punctual::Light;
use crate::spec::volume_spec::TransmittanceFunctionSpec;

fn read(text: &str) -> Result<GltfScene, Error> {
    parse("folder/a.gltf", text.as_bytes(), 683.0)
}

fn with_nodes(nodes: &str, more: &str) -> String {
    format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"scenes\":[{{\"nodes\":[0]}}],\"nodes\":{nodes}{more}}}"
    )
}

#[test]
fn extension_extras_object_and_flat_keys_say_the_same() {
    let object = r#"{"vdb":"a b.vdb","density":{"grid":"d","scale":8},"up_axis":"z",
        "albedo":[0.8,0.8,0.85],"phase":{"type":"henyey_greenstein","g":0.3},
        "law":{"type":"table","file":"a b.csv"}}"#;
    let uri = object.replace("a b", "a%20b");
    let flat = r#"{"pileus_vdb":"a b.vdb","pileus_grid":"d","pileus_density_scale":8,
        "pileus_up_axis":"z","pileus_albedo":[0.8,0.8,0.85],"pileus_g":0.3,
        "pileus_law":"table","pileus_law_file":"a b.csv","other":[]}"#;
    let nodes = [
        format!(r#"[{{"extensions":{{"PILEUS_volume":{uri}}}}}]"#),
        format!(r#"[{{"extras":{{"pileus_volume":{object}}}}}]"#),
        format!(r#"[{{"extras":{flat}}}]"#),
    ];
    let specs = nodes.map(|nodes| {
        let scene = read(&with_nodes(&nodes, "")).unwrap();
        assert_eq!(scene.volumes.len(), 1);
        scene.volumes[0].spec.clone()
    });
    assert_eq!(specs[0], specs[1]);
    assert_eq!(specs[0], specs[2]);
    assert_eq!(Path::new(specs[0].vdb.as_ref().unwrap()), Path::new("folder/a b.vdb"));
    let Some(TransmittanceFunctionSpec::Table { file }) = &specs[0].law else {
        panic!("{:?}", specs[0].law)
    };
    assert_eq!(Path::new(file), Path::new("folder/a b.csv"));
}

#[test]
fn wrong_volume_keys_are_placed() {
    let text =
        with_nodes("[{\n\"extensions\":{\"PILEUS_volume\":{\"vdb\":\"a\",\n \"albdo\":1}}}]", "");
    let error = read(&text).unwrap_err();
    assert_eq!((error.place().line, error.place().column), (Some(3), Some(2)));
    assert_eq!(error.place().part.as_deref(), Some("/nodes/0/extensions/PILEUS_volume/albdo"));
    assert!(error.remedy().contains("did you mean `albedo`?"), "{}", error.remedy());

    let error = read(&with_nodes(r#"[{"extras":{"pileus_vdb":"a","pileus_albdo":1}}]"#, ""));
    let error = error.unwrap_err();
    assert!(error.remedy().contains("did you mean `pileus_albedo`?"));
    assert_eq!(error.place().part.as_deref(), Some("/nodes/0/extras/pileus_albdo"));
    for extras in [
        r#"{"pileus_g":1}"#,
        r#"{"pileus_vdb":1}"#,
        r#"{"pileus_vdb":"a","pileus_g":"x"}"#,
        r#"{"pileus_vdb":"a","pileus_albedo":[1,2]}"#,
        r#"{"pileus_vdb":"a","pileus_up_axis":"x"}"#,
        r#"{"pileus_vdb":"a","pileus_law":"power"}"#,
        r#"{"pileus_vdb":"a","pileus_law":"mixture"}"#,
        r#"{"pileus_vdb":"a","pileus_law_k":2}"#,
        r#"{"pileus_vdb":"a","pileus_law":"erlang","pileus_law_n":2.5}"#,
        r#"{"pileus_vdb":"a","pileus_law":"erlang","pileus_law_n":2,"pileus_law_k":2}"#,
    ] {
        let error = read(&with_nodes(&format!(r#"[{{"extras":{extras}}}]"#), ""));
        assert!(matches!(error, Err(Error::Invalid { .. })), "{extras}");
    }
    for extras in ["3", "[1]", "null", "{\"density\":3}"] {
        let scene = read(&with_nodes(&format!(r#"[{{"extras":{extras}}}]"#), "")).unwrap();
        assert!(scene.volumes.is_empty());
    }
}

#[test]
fn lights_get_radiometric_units_and_directions() {
    let lights = |lights: &str| {
        format!(r#","extensions":{{"KHR_lights_punctual":{{"lights":[{lights}]}}}}"#)
    };
    // A quarter turn about X takes -Z to -Y... seen from the light: it shines upwards for +.
    let node = r#"[{"rotation":[0.70710678,0,0,0.70710678],"translation":[1,2,3],
        "extensions":{"KHR_lights_punctual":{"light":0}}}]"#;
    let read_one = |text: &str| read(&with_nodes(node, &lights(text))).map(|s| s.lights[0].clone());
    let sun = read_one(r#"{"type":"directional","color":[1,0.5,0],"intensity":1366}"#).unwrap();
    let Light::Sun(sun) = sun else { panic!("{sun:?}") };
    assert!((sun.irradiance - Vec3::new(2.0, 1.0, 0.0)).length() < 1e-6);
    assert!((sun.to_light - Vec3::NEG_Y).length() < 1e-6, "{}", sun.to_light);
    let spot =
        read_one(r#"{"type":"spot","intensity":683,"spot":{"outerConeAngle":0.5}}"#).unwrap();
    let Light::Spot(spot) = spot else { panic!("{spot:?}") };
    assert!((spot.direction - Vec3::Y).length() < 1e-6);
    assert_eq!((spot.cos_inner, spot.cos_outer), (1.0, 0.5f32.cos()));
    assert_eq!(spot.position, DVec3::new(1.0, 2.0, 3.0));
    let point = read_one(r#"{"type":"point","intensity":6830}"#).unwrap();
    let Light::Point(point) = point else { panic!("{point:?}") };
    assert!((point.intensity.x - 10.0).abs() < 1e-6);
    for bad in [
        r#"{"type":"area"}"#,
        r#"{"type":"point","intensity":-1}"#,
        r#"{"type":"point","intensity":1e300}"#,
        r#"{"type":"spot","spot":{"innerConeAngle":1,"outerConeAngle":0.5}}"#,
    ] {
        assert!(matches!(read_one(bad), Err(Error::Invalid { .. })), "{bad}");
    }
}

#[test]
fn damaged_trees_are_errors() {
    let invalid = |text: &str| matches!(read(text), Err(Error::Invalid { .. }));
    assert!(invalid(&with_nodes(r#"[{"children":[0]}]"#, "")));
    assert!(invalid(&with_nodes(r#"[{"children":[1]},{"children":[0]}]"#, "")));
    assert!(invalid(&with_nodes(r#"[{"children":[1,1]},{}]"#, "")));
    assert!(invalid(&with_nodes(r#"[{"children":[7]}]"#, "")));
    assert!(invalid(&with_nodes(r#"[{"camera":3}]"#, "")));
    assert!(invalid(&with_nodes("[{}]", ",\"scene\":4")));
    assert!(invalid(&with_nodes("[]", "")));
    assert!(invalid(&with_nodes(r#"[{"rotation":[0,0,0,0]}]"#, "")));
    assert!(!invalid(&with_nodes(r#"[{"scale":[1e30,1,1]}]"#, "")));
    assert!(invalid(&with_nodes(r#"[{"scale":[1e300,1,1]}]"#, "")));
    assert!(invalid(&with_nodes(r#"[{"extensions":{"KHR_lights_punctual":{"light":0}}}]"#, "")));
    assert!(invalid("{}"));
    assert!(invalid("glTF"));
    // Ten thousand levels deep: no recursion.
    let chain: Vec<String> =
        (1..10_000).map(|i| format!("{{\"children\":[{i}]}}")).chain(["{}".into()]).collect();
    assert!(read(&with_nodes(&format!("[{}]", chain.join(",")), "")).is_ok());
}

#[test]
fn required_extensions_are_listed_when_unknown() {
    let more = r#","extensionsRequired":["KHR_lights_punctual","VENDOR_a","KHR_materials_ior","VENDOR_b"]"#;
    let error = read(&with_nodes("[{}]", more)).unwrap_err();
    assert!(matches!(error, Error::Unsupported { .. }));
    assert!(error.to_string().contains("VENDOR_a, VENDOR_b"), "{error}");
    let more = r#","extensionsRequired":["PILEUS_volume","KHR_materials_ior"]"#;
    assert!(read(&with_nodes("[{}]", more)).is_ok());
    let old = with_nodes("[{}]", "").replace("2.0", "1.0");
    assert!(matches!(read(&old), Err(Error::Unsupported { .. })));
}

#[test]
fn binary_containers_are_split_and_checked() {
    let text = with_nodes("[{}]", "");
    let mut glb = b"glTF".to_vec();
    for word in [2, 20 + text.len() as u32, text.len() as u32] {
        glb.extend(word.to_le_bytes());
    }
    glb.extend(b"JSON");
    glb.extend(text.as_bytes());
    assert!(parse("a.glb", &glb, 683.0).is_ok());
    for length in 0..glb.len() {
        assert!(parse("a.glb", &glb[..length], 683.0).is_err(), "{length}");
    }
    let mut wrong = glb.clone();
    wrong[4] = 1;
    assert!(matches!(parse("a.glb", &wrong, 683.0), Err(Error::Unsupported { .. })));
    wrong = glb;
    wrong[12..16].fill(0xff);
    assert!(parse("a.glb", &wrong, 683.0).is_err());
}

#[test]
fn transforms_multiply_down_the_tree() {
    let nodes = r#"[{"translation":[1,0,0],"scale":[2,2,2],"children":[1]},
        {"matrix":[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,3,0,1],"camera":0,"name":"C"}]"#;
    let camera = r#","cameras":[{"type":"perspective","perspective":{"yfov":0.5,"znear":0.1,"aspectRatio":1.5}}]"#;
    let scene = read(&with_nodes(nodes, camera)).unwrap();
    let camera = &scene.cameras[0];
    assert_eq!(camera.node, "C");
    assert_eq!(camera.to_world.translation, DVec3::new(1.0, 6.0, 0.0));
    assert!((camera.fov_y_degrees.unwrap() - 0.5f64.to_degrees()).abs() < 1e-5);
    assert_eq!(camera.aspect_ratio, Some(1.5));
}
