//! What the schema of volumes says beyond the types of keys: ranges that hold for several keys, and
//! which keys need or exclude each other. The loader refuses the same.

use pileus_media::phase::MAX_G;
use serde_json::{Value, json};

use super::option::written;
use super::schema_rule::{absent, both, given, implies, later, none_of, not_both, rule, with};

/// Largest extinction, emission and other factor.
const LARGEST: f64 = 1e30;

/// A factor of at least 0.
pub(crate) fn factor(schema: &mut schemars::Schema) {
    schema.insert("minimum".into(), 0.into());
    schema.insert("maximum".into(), LARGEST.into());
}

/// A number of either sign that single precision can follow.
pub(crate) fn offset(schema: &mut schemars::Schema) {
    schema.insert("minimum".into(), (-LARGEST).into());
    schema.insert("maximum".into(), LARGEST.into());
}

/// Numbers or colours of at most `largest`, in addition to what their own schema says.
pub(crate) fn at_most(largest: f64) -> impl Fn(&mut schemars::Schema) {
    move |schema| {
        schema.insert("maximum".into(), largest.into());
        schema.insert("items".into(), json!({ "maximum": largest }));
    }
}

/// A mean cosine that single precision can follow.
pub(crate) fn cosine(schema: &mut schemars::Schema) {
    schema.insert("minimum".into(), (-written(MAX_G)).into());
    schema.insert("maximum".into(), written(MAX_G).into());
}

/// Which keys of a volume go together.
pub(crate) fn volume() -> Value {
    let grid_keys = ["density", "interpolation", "frame", "emission"];
    let by_grid = ["axis_grid", "roughness_grid", "diagonal_grid", "off_diagonal_grid"];
    json!([
        rule(
            json!({ "anyOf": [given("vdb"), given("homogeneous")] }),
            "the volume has neither `vdb` nor `homogeneous`",
            "name an OpenVDB file with `vdb`",
        ),
        rule(
            not_both(given("vdb"), given("homogeneous")),
            "the volume has both `vdb` and `homogeneous`",
            "write two volumes: media may overlap",
        ),
        rule(
            implies(given("homogeneous"), none_of(&grid_keys)),
            "a key of this volume belongs to volumes with a grid (density, interpolation, frame, emission)",
            "remove it, or replace `homogeneous` by `vdb`; light and fog can be two volumes that overlap",
        ),
        rule(
            implies(
                given("homogeneous"),
                json!({ "properties": {
                    "albedo": { "not": { "type": "object" } },
                    "phase": { "properties": {
                        "g": { "not": { "type": "object" } },
                        "distribution": none_of(&by_grid),
                    } },
                } }),
            ),
            "a homogeneous volume has no grids",
            "give numbers instead of grids",
        ),
        rule(
            not_both(given("law"), given("law_mixture")),
            "the volume has both `law` and `law_mixture`",
            "keep one; a transmittance function can be a component of the mixture",
        ),
    ])
}

/// Which keys belong to which shape of microflakes.
pub(crate) fn microflakes() -> Value {
    let along = ["axis", "axis_grid", "roughness", "roughness_grid"];
    let matrix = ["diagonal", "off_diagonal", "diagonal_grid", "off_diagonal_grid"];
    let shape = |names: &[&str]| with("shape", json!({ "enum": names }));
    let foreign = |names: &[&str], keys: &[&str]| {
        rule(
            implies(shape(names), none_of(keys)),
            "a key does not belong to this shape",
            "remove it, or choose another `shape`",
        )
    };
    let one = |value: &str, grid: &str| {
        let what = format!("`{value}` and `{grid}` each say the same");
        rule(not_both(given(value), given(grid)), &what, "keep one of them")
    };
    json!([
        foreign(&["isotropic"], &[along, matrix].concat()),
        foreign(&["fibre", "surface"], &matrix),
        foreign(&["matrix"], &along),
        one("axis", "axis_grid"),
        one("roughness", "roughness_grid"),
        one("diagonal", "diagonal_grid"),
        one("off_diagonal", "off_diagonal_grid"),
        rule(
            implies(
                shape(&["fibre", "surface"]),
                json!({ "anyOf": [
                    both(given("axis"), given("roughness")),
                    both(given("axis_grid"), given("roughness")),
                    both(given("axis_grid"), given("roughness_grid")),
                ] }),
            ),
            "axis and roughness of the microflakes are not both given",
            "give `axis` and `roughness`; a grid of roughness needs a grid of axes",
        ),
        rule(
            implies(
                shape(&["matrix"]),
                json!({ "anyOf": [
                    both(given("diagonal"), absent("off_diagonal_grid")),
                    both(given("diagonal_grid"), given("off_diagonal_grid")),
                ] }),
            ),
            "the matrix of the microflakes is given by half",
            "give the entries xx, yy, zz as `diagonal`, or grids for diagonal and off_diagonal",
        ),
    ])
}

/// Lobes that a mixture can have, and one of them with a weight.
pub(crate) fn lobes(schema: &mut schemars::Schema) {
    let flakes = with("phase", with("type", json!({ "const": "sggx" })));
    let by_grid = with("phase", with("g", json!({ "type": "object" })));
    schema.insert("minItems".into(), 1.into());
    schema.insert("maxItems".into(), 64.into());
    schema.insert(
        "allOf".into(),
        json!([
            rule(
                json!({ "contains": with("weight", json!({ "exclusiveMinimum": 0 })) }),
                "no lobe has a weight",
                "give one a weight above 0",
            ),
            later(
                json!({ "items": { "not": { "anyOf": [flakes, by_grid] } } }),
                "microflakes and cosines by grid cannot be lobes of a mixture",
                "write two volumes: media may overlap",
            ),
        ]),
    );
}

/// Scales of a transform: none is 0.
pub(crate) fn scales(schema: &mut schemars::Schema) {
    let not_zero = json!({ "anyOf": [
        { "type": "number", "minimum": 1e-30, "maximum": LARGEST },
        { "type": "number", "minimum": -LARGEST, "maximum": -1e-30 },
    ] });
    schema.insert(
        "allOf".into(),
        json!([rule(
            json!({ "items": not_zero }),
            "a scale is 0 or out of range",
            "use scales other than 0, from 1e-30 to 1e30",
        )]),
    );
}

/// The law of a matrix by constant entries is a relation between numbers, which a schema cannot
/// say; this is what it can: an entry that is not 0.
pub(crate) fn entries(schema: &mut schemars::Schema) {
    schema.insert("allOf".into(), json!([super::schema_rule::direction()]));
}

/// What holds of the two numbers of a Davis-Weinstein transmittance together.
pub(crate) fn davis_weinstein() -> Value {
    rule(
        implies(with("h", json!({ "const": 1 })), with("c", json!({ "exclusiveMaximum": 1 }))),
        "`c` is 1 or more where `h` is 1",
        "give a `c` below 1: else flights from a surface have no finite mean",
    )
}

/// Colours of a grid's values come from one or the other.
pub(crate) fn color_or_ramp() -> Value {
    rule(
        not_both(given("color"), given("ramp")),
        "the emission has both `color` and `ramp`",
        "remove `color`, and use `scale` for brightness",
    )
}
