//! What the schema of jobs says beyond the types of keys, so that editors find what the program
//! would refuse. What is a relation between several numbers (a crop inside its resolution, a camera
//! that looks at its own place) is left to the program.

use pileus_film::{DENOISED, DENOISED_CHANNELS, DENOISED_MEANING, LAYERS, MAX_PIXELS};
use pileus_scene::schema_rule::{
    absent, both, direction, given, implies, later, none_of, not_both, rule, with,
};
use schemars::Schema;
use serde_json::{Value, json};

/// Pattern: the name of an EXR file; a `#` is not replaced by a frame number, and refused.
pub(crate) const EXR: &str = "^([^\\u0000]*/)?[^#/\\u0000]+\\.[eE][xX][rR]$";
/// Pattern: the name of a PNG file.
pub(crate) const PNG: &str = "^([^\\u0000]*/)?[^#/\\u0000]+\\.[pP][nN][gG]$";
/// Pattern: the name of any file.
pub(crate) const FILE: &str = "^([^\\u0000]*/)?[^#/\\u0000]+$";
/// Pattern: the name of a structure of majorants.
pub(crate) const MAJORANTS: &str =
    "^(auto|adaptive|hierarchy|kd_tree|global|uniform_0*[1-9][0-9]{0,8})$";

/// Which keys of a job need or exclude each other.
pub(crate) fn job() -> Value {
    let bounded = with("bounds", json!({ "type": "array" }));
    let framed = json!({ "anyOf": [given("vdb"), with("homogeneous", bounded)] });
    json!([
        rule(
            implies(with("camera", given("node")), given("scene")),
            "the camera is a node, but the job names no glTF scene",
            "add `scene`",
        ),
        rule(
            json!({ "anyOf": [
                given("scene"),
                with("camera", given("position")),
                with("volumes", json!({ "type": "array", "contains": framed })),
            ] }),
            "there is no camera, and no scene and no volume with an end that could be framed",
            "give the job a `camera` with `position` and `look_at`",
        ),
        rule(
            json!({ "not": both(
                with("denoise", with("when", json!({ "const": "never" }))),
                with("output", with("aovs", json!({ "contains": { "const": DENOISED } }))),
            ) }),
            "the denoised picture is asked for, and that nothing is denoised",
            "remove `denoised` from `aovs`, or `denoise`",
        ),
    ])
}

/// How a camera is placed, and which keys belong to its type.
pub(crate) fn camera() -> Value {
    let of_type = |name: &str| with("type", json!({ "const": name }));
    let not_of_type = |name: &str| json!({ "not": of_type(name) });
    let (flat, panorama) = (|| of_type("orthographic"), || of_type("panorama"));
    let has_lens = with("aperture", json!({ "type": "number", "exclusiveMinimum": 0 }));
    json!([
        rule(
            implies(given("node"), none_of(&["position", "look_at", "up", "fov_y"])),
            "the camera has a `node` and a placement of its own",
            "keep one of the two",
        ),
        rule(
            implies(given("node"), none_of(&["type", "height"])),
            "the camera has a `node`, which says of what type it is",
            "remove `type` and `height`, or place the camera by `position` and `look_at`",
        ),
        rule(
            json!({ "anyOf": [
                both(given("position"), given("look_at")),
                none_of(&["position", "look_at", "up"]),
            ] }),
            "the camera is placed by half",
            "give both `position` and `look_at`, or neither to frame the volumes",
        ),
        rule(
            implies(given("height"), flat()),
            "`height` belongs to orthographic cameras",
            "remove it, or set `type` to \"orthographic\"; perspective cameras have `fov_y`",
        ),
        rule(
            implies(given("fov_y"), both(not_of_type("orthographic"), not_of_type("panorama"))),
            "`fov_y` belongs to perspective cameras",
            "remove it; orthographic cameras have `height`, a panorama shows all directions",
        ),
        rule(
            implies(both(flat(), given("position")), given("height")),
            "it is not clear how much the orthographic camera shows",
            "give `height` in scene units",
        ),
        rule(
            implies(panorama(), given("position")),
            "the panorama has no place",
            "give `position` and `look_at`, where its middle looks",
        ),
        rule(
            implies(panorama(), none_of(&["aperture", "focus_distance", "focus_on", "blades"])),
            "a panorama has no lens",
            "remove `aperture`, `focus_distance`, `focus_on` and `blades`: all is sharp",
        ),
        rule(
            not_both(given("focus_distance"), given("focus_on")),
            "the camera is focused twice",
            "keep `focus_distance` or `focus_on`",
        ),
        rule(
            implies(
                json!({ "anyOf": [given("focus_distance"), given("focus_on"), given("blades")] }),
                given("aperture"),
            ),
            "the camera has a focus or blades, but no aperture",
            "give `aperture`, the diameter of the lens, or remove them: all is sharp",
        ),
        rule(
            implies(
                has_lens,
                json!({ "anyOf": [given("focus_distance"), given("focus_on"), given("look_at")] }),
            ),
            "it is not clear what the camera's lens is focused on",
            "give `focus_distance`, or a point with `focus_on`",
        ),
    ])
}

/// No blades, or enough for a polygon.
pub(crate) fn blades(schema: &mut Schema) {
    insert_rule(
        schema,
        rule(
            json!({ "not": { "enum": [1, 2] } }),
            "an aperture of 1 or 2 blades has no area",
            "use 0 for a round one, or 3 and more",
        ),
    );
}

/// What an environment is made of.
pub(crate) fn environment() -> Value {
    json!([
        rule(
            json!({ "oneOf": [given("radiance"), given("image")] }),
            "an environment has either `radiance` or `image`",
            "give one of the two",
        ),
        rule(
            implies(given("radiance"), none_of(&["intensity", "rotation_y"])),
            "`intensity` and `rotation_y` belong to environments with an `image`",
            "remove them",
        ),
    ])
}

/// Where the sun of a sky stands.
pub(crate) fn sky() -> Value {
    json!([rule(
        json!({ "anyOf": [
            both(given("to_sun"), none_of(&["elevation", "azimuth"])),
            both(given("elevation"), absent("to_sun")),
        ] }),
        "it is not clear where the sky's sun stands",
        "give either `to_sun`, or `elevation` and `azimuth`",
    )])
}

/// One image of the environment at most, a sky being one.
pub(crate) fn one_image(schema: &mut Schema) {
    let kind = |name: &str| with("type", json!({ "const": name }));
    let image = json!({ "anyOf": [kind("sky"), both(kind("environment"), given("image"))] });
    let one = json!({ "contains": image, "minContains": 0, "maxContains": 1 });
    insert_rule(
        schema,
        later(
            one,
            "there are two images of the environment (a sky is one)",
            "use one `sky` or one `image`; constant environments may be added to it",
        ),
    );
}

/// A vector with a direction.
pub(crate) fn directed(schema: &mut Schema) {
    insert_rule(schema, direction());
}

/// Numbers or colours of at most 1.
pub(crate) fn at_most_one(schema: &mut Schema) {
    schema.insert("maximum".into(), 1.into());
    schema.insert("items".into(), json!({ "maximum": 1 }));
}

/// The image has pixels, and neither side exceeds what an image may have in all.
pub(crate) fn resolution(schema: &mut Schema) {
    insert_rule(
        schema,
        rule(
            json!({ "items": { "minimum": 1, "maximum": MAX_PIXELS } }),
            "the image has no pixels, or too many",
            "use a width and a height of at least 1, and fewer than 2^28 pixels",
        ),
    );
}

/// The crop has pixels.
pub(crate) fn crop(schema: &mut Schema) {
    let side = json!({ "minimum": 1 });
    insert_rule(
        schema,
        rule(
            json!({ "prefixItems": [true, true, side, side] }),
            "the crop is empty",
            "give left, top, width and height in pixels inside the resolution",
        ),
    );
}

/// Where the layers go, once.
pub(crate) fn output() -> Value {
    let in_image = || with("layers_in_image", json!({ "const": true }));
    let nowhere = with("layers", json!({ "type": "null" }));
    let asked_for = with("aovs", json!({ "type": "array", "minItems": 1 }));
    json!([
        rule(
            implies(in_image(), none_of(&["layers"])),
            "the layers go into the image and into a file of their own",
            "remove `layers` or `layers_in_image`",
        ),
        rule(
            implies(both(nowhere, asked_for), in_image()),
            "layers are asked for that go nowhere",
            "name a file with `layers`, or remove `aovs`",
        ),
    ])
}

/// The layers that there are, by the film's table.
pub(crate) fn aovs(schema: &mut Schema) {
    let layers = || LAYERS.into_iter().filter(|layer| !layer.is_picture());
    let names: Vec<&str> = layers().map(|layer| layer.name).chain([DENOISED]).collect();
    let known = format!("take of: {}", names.join(", "));
    let items = json!({ "type": "string", "enum": names });
    let items = later(items, "there is no such layer in this version", &known);
    schema.insert("items".into(), items);
    schema.insert("uniqueItems".into(), true.into());
    let mut text = schema.get("description").and_then(Value::as_str).unwrap_or("").to_owned();
    let of_films = layers().map(|layer| (layer.name, layer.channels, layer.meaning));
    let denoised = (DENOISED, DENOISED_CHANNELS.as_slice(), DENOISED_MEANING);
    for (name, channels, meaning) in of_films.chain([denoised]) {
        let channels: Vec<String> = channels.iter().map(|c| format!("`{c}`")).collect();
        text += &format!(" `{name}` ({}): {meaning}.", channels.join(", "));
    }
    schema.insert("description".into(), text.into());
}

/// No motion yet.
pub(crate) fn shutter(schema: &mut Schema) {
    insert_rule(
        schema,
        later(
            json!({ "items": { "const": 0 } }),
            "motion is not rendered by this version",
            "set the shutter to [0, 0] or remove it",
        ),
    );
}

fn insert_rule(schema: &mut Schema, fragment: Value) {
    schema.insert("allOf".into(), json!([fragment]));
}
