//! Schema and program accept and refuse the same jobs.

use std::path::{Path, PathBuf};

use pileus::failure::Failure;
use pileus::input::{Input, VdbOptions};
use pileus::schema;
use pileus::settings::{Overrides, Settings};
use pileus::validate::validate;
use serde_json::{Map, Value, json};

/// Makes values at random from a schema.
struct Generator {
    state: u64,
    definitions: Map<String, Value>,
}

impl Generator {
    fn new(seed: u64) -> Self {
        Self { state: seed, definitions: schema::definitions_by_name() }
    }

    /// The generator splitmix64.
    fn next(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, count: usize) -> usize {
        (self.next() % count as u64) as usize
    }

    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn one_in(&mut self, count: usize) -> bool {
        self.below(count) == 0
    }

    /// A value of the types, within the ranges and of the length that the schema says; what its
    /// rules say of several keys is left to chance.
    fn value(&mut self, schema: &Value, depth: usize) -> Value {
        if let Some(name) = schema["$ref"].as_str() {
            let definition = self.definitions[name.rsplit('/').next().unwrap()].clone();
            return self.value(&definition, depth);
        }
        if let Some(value) = schema.get("const") {
            return value.clone();
        }
        if let Some(list) = schema["enum"].as_array() {
            return list[self.below(list.len())].clone();
        }
        let choices = schema["oneOf"].as_array().or(schema["anyOf"].as_array());
        if let Some(choices) = choices.filter(|_| schema.get("properties").is_none()) {
            let null = self.one_in(20);
            let fitting: Vec<&Value> =
                choices.iter().filter(|choice| (choice["type"] == "null") == null).collect();
            let fitting = if fitting.is_empty() { choices.iter().collect() } else { fitting };
            let choice = fitting[self.below(fitting.len())].clone();
            let mut value = self.value(&choice, depth);
            // Ranges that stand beside the choice.
            if let (Some(most), Some(number)) = (schema["maximum"].as_f64(), value.as_f64()) {
                value = number.min(most).into();
            }
            return value;
        }
        let kinds: Vec<String> = match &schema["type"] {
            Value::Array(kinds) => kinds.iter().map(|k| k.as_str().unwrap().to_owned()).collect(),
            kind => vec![kind.as_str().unwrap_or_else(|| panic!("{schema}")).to_owned()],
        };
        let may_be_null = kinds.iter().any(|kind| kind == "null");
        let null = may_be_null && (kinds.len() == 1 || self.one_in(20));
        let kind = if null { "null" } else { kinds.iter().find(|k| *k != "null").unwrap() };
        match kind {
            "null" => Value::Null,
            "boolean" => self.one_in(2).into(),
            "integer" => self.integer(schema),
            "number" => self.number(schema),
            "string" => self.text(schema),
            "array" => self.list(schema, depth),
            "object" => self.object(schema, depth),
            other => panic!("{other}"),
        }
    }

    fn integer(&mut self, schema: &Value) -> Value {
        let low = schema["minimum"].as_i64().unwrap_or(0).max(-1000);
        let high = schema["maximum"].as_u64().map_or(1000, |high| high.min(1000)) as i64;
        let value = low + (self.unit() * (high - low) as f64) as i64;
        if self.one_in(4) { json!(value as f64) } else { json!(value) }
    }

    fn number(&mut self, schema: &Value) -> Value {
        let limit = |keys: [&str; 2]| keys.iter().find_map(|key| schema[*key].as_f64());
        let low = limit(["minimum", "exclusiveMinimum"]).unwrap_or(-10.0).max(-1e3);
        let high = limit(["maximum", "exclusiveMaximum"]).unwrap_or(1e3).min(low + 1e3);
        match self.below(6) {
            // The ends themselves, where they belong to the range.
            0 if schema["minimum"].is_number() && low > -1e3 => schema["minimum"].clone(),
            1 if schema["maximum"].is_number() && schema["maximum"].as_f64() == Some(high) => {
                schema["maximum"].clone()
            }
            2 if low < 1.0 && high > 1.0 => json!(1),
            _ => json!(low + (high - low) * (0.001 + 0.998 * self.unit())),
        }
    }

    fn text(&mut self, schema: &Value) -> Value {
        let pattern = schema["pattern"].as_str().unwrap_or_default();
        // One of the examples, or a plain name.
        let examples = schema["examples"].as_array().filter(|list| !list.is_empty());
        match examples {
            Some(list) => list[self.below(list.len())].clone(),
            None if pattern.contains("uniform") => "global".into(),
            None => format!("name{}", self.below(9)).into(),
        }
    }

    fn list(&mut self, schema: &Value, depth: usize) -> Value {
        let least = schema["minItems"].as_u64().unwrap_or(0) as usize;
        let most = schema["maxItems"].as_u64().map_or(2, |most| most.min(4)) as usize;
        let mut count = least + self.below(most.max(least) - least + 1);
        if depth > 6 {
            count = least;
        }
        (0..count).map(|_| self.value(&schema["items"], depth + 1)).collect()
    }

    fn object(&mut self, schema: &Value, depth: usize) -> Value {
        let required: Vec<&str> =
            schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        let mut object = Map::new();
        for (key, schema) in schema["properties"].as_object().unwrap() {
            if required.contains(&key.as_str()) || self.one_in(if depth == 0 { 2 } else { 4 }) {
                object.insert(key.clone(), self.value(schema, depth + 1));
            }
        }
        Value::Object(object)
    }

    /// A job with what rules ask for, as far as chance seldom gives it.
    fn job(&mut self) -> Value {
        let mut job = self.value(&schema::job_schema(), 0);
        if self.one_in(8) {
            return job;
        }
        let camera = job.get("camera").is_some_and(|camera| camera.is_object());
        if camera && job["camera"].get("node").is_none_or(Value::is_null) {
            job["camera"]["position"] = json!([self.unit(), 2, 3]);
            job["camera"]["look_at"] = json!([0, self.unit(), 0]);
            self.fit_camera(&mut job);
        } else if camera {
            job["camera"] = json!({ "node": "Camera" });
            job["scene"] = "shot.gltf".into();
        } else {
            job["camera"] = json!({ "position": [5, 2, 3], "look_at": [0, self.unit(), 0] });
        }
        for light in job.get_mut("lights").and_then(Value::as_array_mut).into_iter().flatten() {
            match light["type"].as_str() {
                Some("environment") => *light = json!({ "type": "environment", "radiance": 2.5 }),
                Some("sky") => {
                    let mut sky = json!({ "type": "sky", "elevation": 30 });
                    sky["turbidity"] = light.get("turbidity").cloned().unwrap_or(json!(2));
                    *light = sky;
                }
                _ => {}
            }
        }
        for volume in job.get_mut("volumes").and_then(Value::as_array_mut).into_iter().flatten() {
            let keys = volume.as_object_mut().unwrap();
            if self.one_in(2) {
                keys.retain(|key, _| {
                    !["density", "interpolation", "frame", "emission", "vdb"]
                        .contains(&key.as_str())
                });
                keys.insert("homogeneous".into(), json!({ "sigma_t": 0.5 }));
                keys.insert("albedo".into(), json!(0.5));
            } else {
                keys.remove("homogeneous");
                keys.insert("vdb".into(), "smoke.##.vdb".into());
                keys.insert("frame".into(), json!(3));
            }
            keys.remove("law_mixture");
            if !self.one_in(4) {
                keys.remove("phase");
            }
        }
        job
    }

    /// Makes the keys of a placed camera those of its type.
    fn fit_camera(&mut self, job: &mut Value) {
        let keys = job["camera"].as_object_mut().unwrap();
        keys.remove("up");
        let lens = ["aperture", "focus_distance", "focus_on", "blades"];
        match keys.get("type").and_then(Value::as_str) {
            Some("orthographic") => {
                keys.remove("fov_y");
                keys.insert("height".into(), json!(2.5));
            }
            Some("panorama") => {
                let other =
                    |key: &String| lens.contains(&&**key) || key == "fov_y" || key == "height";
                keys.retain(|key, _| !other(key));
            }
            _ => {
                keys.remove("height");
            }
        }
        if keys.contains_key("focus_on") {
            keys.remove("focus_distance");
        }
        if lens.iter().any(|key| keys.contains_key(*key)) {
            keys.insert("aperture".into(), json!(self.unit()));
        }
    }

    /// Changes one value somewhere: another type, beyond its range, gone, or a key too much.
    fn mutate(&mut self, job: &mut Value) {
        let mut pointers = Vec::new();
        collect(job, "", &mut pointers);
        let pointer = pointers[self.below(pointers.len())].clone();
        let place = job.pointer_mut(&pointer).unwrap();
        let number = place.as_f64().unwrap_or(1.0);
        let wrong = [
            Value::Null,
            json!([]),
            json!({}),
            json!("text"),
            json!(-1),
            json!(0),
            json!(0.5),
            json!(1e30),
            json!(18_446_744_073_709_551_615u64),
            json!(18_446_744_073_709_551_616f64),
            json!(number + 0.25),
            json!(-number),
            json!(number * 1e6),
            json!([0, 0, 0]),
            json!([1, 2]),
            json!(true),
        ];
        if let (Value::Object(keys), true) = (&mut *place, self.one_in(2)) {
            if self.one_in(2) {
                keys.insert("surplus".into(), json!(1));
            } else if let Some(key) = keys.keys().next().cloned() {
                keys.remove(&key);
            }
            return;
        }
        *place = wrong[self.below(wrong.len())].clone();
    }
}

fn collect(value: &Value, pointer: &str, found: &mut Vec<String>) {
    if !pointer.is_empty() {
        found.push(pointer.to_owned());
    }
    match value {
        Value::Object(keys) => {
            keys.iter().for_each(|(key, value)| collect(value, &format!("{pointer}/{key}"), found));
        }
        Value::Array(list) => {
            let items = list.iter().enumerate();
            items.for_each(|(i, value)| collect(value, &format!("{pointer}/{i}"), found));
        }
        _ => {}
    }
}

/// What the program says of a job without looking for its files.
fn program(path: &Path, job: &Value) -> Result<(), Failure> {
    std::fs::write(path, job.to_string()).unwrap();
    let input = Input::open(path, &VdbOptions::default())?;
    Settings::resolve(input, &Overrides::default()).map(drop)
}

/// What only the program can say: relations between several numbers.
const RELATIONS: [&str; 2] = ["the crop", "pixels"];

/// 100 jobs that the schema accepts and 200 that it refuses, drawn from it: the program does the
/// same, and so does its own validator. Refusals of the program alone are those of relations.
#[test]
fn schema_and_program_accept_the_same_jobs() {
    let folder = tempfile::tempdir().unwrap();
    let path: PathBuf = folder.path().join("job.json");
    let job_schema = schema::job_schema();
    let validator = jsonschema::validator_for(&job_schema).unwrap();
    let mut generator = Generator::new(20_261_129);
    let (mut good, mut bad, mut relations) = (0, 0, 0);
    let mut keys = std::collections::BTreeSet::new();
    while good < 100 || bad < 200 {
        let mut job = generator.job();
        if bad < 200 && generator.one_in(2) {
            generator.mutate(&mut job);
        }
        let accepted = validator.is_valid(&job);
        let own = validate(&job_schema, &job);
        assert_eq!(own.is_ok(), accepted, "{own:?}\n{job:#}");
        let said = program(&path, &job);
        match (&said, accepted) {
            (Ok(()), true) => {
                good += 1;
                let mut pointers = Vec::new();
                collect(&job, "", &mut pointers);
                keys.extend(pointers.iter().map(|p| p.rsplit('/').next().unwrap().to_owned()));
            }
            (Err(_), false) => bad += 1,
            (Err(said), true) if RELATIONS.iter().any(|word| said.to_string().contains(word)) => {
                relations += 1;
            }
            _ => panic!("schema: {accepted}, program: {said:?}\n{job:#}"),
        }
        assert!(good + bad + relations < 20_000, "{good} good, {bad} bad, {relations} relations");
    }
    // They are no small jobs.
    assert!(keys.len() > 60, "{keys:?}");
    assert!(relations < 100, "{relations}");
}

/// Bad values, each alone in a job that is good otherwise: refused by both.
#[test]
fn ranges_stand_in_the_schema() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("job.json");
    let job_schema = schema::job_schema();
    let validator = jsonschema::validator_for(&job_schema).unwrap();
    let good = json!({
        "volumes": [
            { "vdb": "a.vdb", "density": { "scale": 1 }, "albedo": 0.5 },
            { "homogeneous": { "sigma_t": 0.1, "bounds": null } }
        ],
        "camera": { "position": [0, 1, 5], "look_at": [0, 1, 0] },
        "gltf": {},
        "lights": [
            { "type": "sun", "to_light": [0, 1, 0], "irradiance": 3 },
            { "type": "environment", "radiance": 1 },
            { "type": "point", "position": [0, 0, 0], "intensity": [1, 2, 3] }
        ],
        "film": { "resolution": [8, 8], "filter": {} },
        "sampling": { "spp": 4 },
        "output": { "image": "a.exr" }
    });
    let both = |job: &Value| (validator.is_valid(job), program(&path, job));
    let (schema_says, said) = both(&good);
    assert!(schema_says && said.is_ok(), "{said:?}");
    let sky = |keys: Value| {
        let mut sky = keys;
        sky["type"] = "sky".into();
        sky
    };
    let placed = |keys: Value| {
        let mut camera = keys;
        (camera["position"], camera["look_at"]) = (json!([0, 1, 5]), json!([0, 1, 0]));
        camera
    };
    let lens = |keys: Value| {
        let mut camera = placed(keys);
        camera["aperture"] = 0.1.into();
        camera
    };
    for (pointer, value) in [
        ("/sampling/spp", json!(0)),
        ("/sampling/spp", json!(1.5)),
        ("/sampling/spp", json!(4_294_967_297u64)),
        ("/sampling/seed", json!(18_446_744_073_709_551_616f64)),
        ("/sampling/max_bounces", json!(4_294_967_296u64)),
        ("/sampling/level_exponent", json!(1)),
        ("/sampling/clamp", json!(0)),
        ("/sampling/majorant_scale", json!(-1)),
        ("/sampling/majorants", json!("uniform_0")),
        ("/sampling/majorants", json!("octree")),
        ("/sampling", json!([4])),
        ("/film", json!([[8, 8]])),
        ("/film/resolution", json!([0, 8])),
        ("/film/crop", json!([0, 0, 0, 8])),
        ("/film/filter/radius", json!(0)),
        ("/film/filter/radius", json!(65)),
        ("/output/image", json!("a.jpg")),
        ("/output/image", json!("a.####.exr")),
        ("/output/image", json!(".exr")),
        ("/output/preview", json!("a.jpeg")),
        ("/output/exposure", json!(65)),
        ("/output/aovs", json!(["velocity"])),
        ("/camera/up", json!([0, 0, 0])),
        ("/camera/fov_y", json!(180)),
        ("/camera/shutter", json!([0, 0.5])),
        ("/camera/node", json!("Camera")),
        ("/camera", json!({ "position": [0, 0, 0] })),
        ("/camera", json!({ "up": [0, 1, 0] })),
        ("/camera", json!({ "node": "Camera" })),
        ("/camera/type", json!("fisheye")),
        ("/camera/type", json!("orthographic")),
        ("/camera/height", json!(2)),
        ("/camera/aperture", json!(-0.1)),
        ("/camera/focus_distance", json!(2)),
        ("/camera/focus_on", json!([0, 0, 0])),
        ("/camera/blades", json!(5)),
        ("/camera", lens(json!({ "blades": 1 }))),
        ("/camera", lens(json!({ "blades": 2 }))),
        ("/camera", lens(json!({ "blades": 65 }))),
        ("/camera", lens(json!({ "focus_distance": 0 }))),
        ("/camera", lens(json!({ "focus_distance": -1 }))),
        ("/camera", lens(json!({ "focus_distance": 1, "focus_on": [0, 0, 0] }))),
        ("/camera", json!({ "aperture": 0.1 })),
        ("/camera", lens(json!({ "type": "panorama" }))),
        ("/camera", placed(json!({ "type": "panorama", "fov_y": 35 }))),
        ("/camera", placed(json!({ "type": "panorama", "height": 1 }))),
        ("/camera", json!({ "type": "panorama" })),
        ("/camera", placed(json!({ "type": "orthographic" }))),
        ("/camera", placed(json!({ "type": "orthographic", "height": 0 }))),
        ("/camera", placed(json!({ "type": "orthographic", "height": 1, "fov_y": 35 }))),
        ("/camera", json!({ "node": "Camera", "type": "orthographic" })),
        ("/gltf/lumens_per_watt", json!(0)),
        ("/lights/0/to_light", json!([0, 0, 0])),
        ("/lights/0/irradiance", json!(-1)),
        ("/lights/0/irradiance", json!([1, 1, 1e39])),
        ("/lights/0/angular_diameter", json!(180)),
        ("/lights/1", json!({ "type": "environment" })),
        ("/lights/1", json!({ "type": "environment", "radiance": 1, "image": "a.exr" })),
        ("/lights/1", json!({ "type": "environment", "radiance": 1, "intensity": 2 })),
        ("/lights/1", json!({ "type": "environment", "image": "a.exr", "intensity": -2 })),
        ("/lights/1", sky(json!({}))),
        ("/lights/1", sky(json!({ "azimuth": 1 }))),
        ("/lights/1", sky(json!({ "elevation": -7 }))),
        ("/lights/1", sky(json!({ "elevation": 5, "to_sun": [0, 1, 0] }))),
        ("/lights/1", sky(json!({ "elevation": 5, "turbidity": 11 }))),
        ("/lights/1", sky(json!({ "elevation": 5, "ground_albedo": [0, 0, 1.5] }))),
        ("/lights", json!([sky(json!({ "elevation": 5 })), sky(json!({ "elevation": 5 }))])),
        ("/volumes/0", json!({})),
        ("/volumes/0/homogeneous", json!({ "sigma_t": 1 })),
        ("/volumes/0/vdb", json!("a.##.b.#.vdb")),
        ("/volumes/0/density/scale", json!(-1)),
        ("/volumes/0/albedo", json!(1.5)),
        ("/volumes/0/extinction", json!([1, -1, 1])),
        ("/volumes/0/interpolation", json!("tricubic")),
        ("/volumes/0/transform", json!({ "scale": [1, 0, 1] })),
        ("/volumes/0/phase", json!({ "type": "henyey_greenstein", "g": 1 })),
        ("/volumes/0/phase", json!({ "type": "mie", "droplet_diameter": 0 })),
        ("/volumes/0/phase", json!({ "type": "draine", "g": 0.5, "alpha": -1 })),
        ("/volumes/0/phase", json!({ "type": "mixture", "lobes": [] })),
        (
            "/volumes/0/phase",
            json!({ "type": "mixture", "lobes": [{ "weight": 0, "phase": { "type": "rayleigh" } }] }),
        ),
        ("/volumes/0/phase", json!({ "type": "sggx", "distribution": { "shape": "fibre" } })),
        ("/volumes/0/law", json!({ "type": "power", "k": 1 })),
        ("/volumes/0/law", json!({ "type": "erlang", "n": 65 })),
        ("/volumes/0/law", json!({ "type": "davis_weinstein", "h": 1, "c": 1 })),
        ("/volumes/0/law_mixture", json!([])),
        ("/volumes/0/emission", json!({ "type": "grid", "grid": "a", "scale": -1 })),
        (
            "/volumes/0/emission",
            json!({ "type": "grid", "grid": "a", "color": 1, "ramp": [{ "value": 0, "color": 0 }] }),
        ),
        ("/volumes/1/homogeneous/sigma_t", json!(-1)),
        ("/volumes/1/density", json!({ "scale": 1 })),
        ("/volumes/1/frame", json!(1)),
        ("/volumes/1/albedo", json!({ "grid": "Cd" })),
        ("/volumes/1/phase", json!({ "type": "henyey_greenstein", "g": { "grid": "g" } })),
    ] {
        let mut job = good.clone();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        match job.pointer_mut(pointer) {
            Some(place) => *place = value.clone(),
            None => job.pointer_mut(parent).unwrap()[key] = value.clone(),
        }
        let (schema_says, said) = both(&job);
        assert!(!schema_says, "the schema accepts {pointer} = {value}");
        let Err(Failure::Scene(error)) = said else {
            panic!("the program says of {pointer} = {value}: {said:?}")
        };
        // At the value, in it, or, where two do not go together, at what holds both.
        let place = error.place();
        let part = place.part.as_deref().unwrap_or_default();
        let parent = if parent.is_empty() { "top level" } else { parent };
        assert!(part.starts_with(pointer) || part == parent, "{pointer}: {error}");
        assert!(place.file.as_deref() == Some(&*path) && place.line.is_some(), "{error}");
    }
    // Nothing at all is no picture.
    for job in [json!({}), json!([]), json!({ "volumes": [{ "homogeneous": { "sigma_t": 1 } }] })] {
        let (schema_says, said) = both(&job);
        let Err(Failure::Scene(error)) = said else { panic!("{job}: {said:?}") };
        assert!(!schema_says && error.place().file.as_deref() == Some(&*path), "{job}: {error}");
    }
}

/// The names of files that the schema's patterns are tried on, and a validator with regular
/// expressions beside the program's own.
#[test]
fn patterns_mean_the_same_to_both() {
    let job_schema = schema::job_schema();
    let names = [
        "a.exr",
        "a.EXR",
        "b/a.eXr",
        "a.exr/",
        ".exr",
        "x/.exr",
        "a.png",
        "a.PNG",
        "",
        "/",
        "a",
        "#",
        "a#.exr",
        "a#/b.exr",
        "a.exr\n",
        "\n.exr",
        "a\u{0}.exr",
        "x\u{0}/a.exr",
        "é.exr",
        "a.éxr",
        "..exr",
        "a.exr.png",
        "fire.####.vdb",
        "a##b#.vdb",
        "#a.vdb",
        "a#",
        "##",
        "d#/a#b",
        "x/#/#",
        "auto",
        "adaptive",
        "uniform_8",
        "uniform_08",
        "uniform_0",
        "uniform_",
        "uniform_1234567890",
        "uniform_+5",
        "global ",
        "kd_tree",
        "uniform_000000000000001",
    ];
    let mut patterns = Vec::new();
    fn find(schema: &Value, patterns: &mut Vec<String>) {
        match schema {
            Value::Object(keys) => {
                patterns.extend(keys.get("pattern").and_then(Value::as_str).map(str::to_owned));
                keys.values().for_each(|value| find(value, patterns));
            }
            Value::Array(list) => list.iter().for_each(|value| find(value, patterns)),
            _ => {}
        }
    }
    find(&job_schema, &mut patterns);
    patterns.sort();
    patterns.dedup();
    assert!(patterns.len() >= 5, "{patterns:?}");
    for pattern in patterns {
        let schema = json!({ "type": "string", "pattern": pattern });
        let validator = jsonschema::validator_for(&schema).unwrap();
        for name in names {
            let own = validate(&schema, &json!(name)).is_ok();
            assert_eq!(own, validator.is_valid(&json!(name)), "{pattern} on {name:?}");
        }
    }
}
