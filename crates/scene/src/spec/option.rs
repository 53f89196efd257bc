//! Options that people write in JSON, each declared once.
//!
//! A row of [`options!`](crate::options) has what is said of an option, its name, type and default,
//! and further facts: limits, unit, what it does to the mean of the image. The type that serde
//! reads, the schema, the reference page and the help of the command line follow from it.

use schemars::Schema;
use serde_json::Value;

/// Declares a struct of options, one row each:
///
/// ```
/// use pileus_scene::option::{above, below, unit};
///
/// pileus_scene::options! {
///     /// A camera.
///     #[derive(Default)]
///     pub struct Camera {
///         /// Full vertical opening angle.
///         fov_y: f64 = 35.0, above(0), below(180), unit("degrees");
///         /// Name of a node.
///         node: String;
///     }
/// }
/// assert_eq!(Camera::default().fov_y(), 35.0);
/// assert_eq!(Camera { fov_y: Some(20.0), ..Camera::default() }.fov_y(), 20.0);
/// ```
///
/// Every option is an `Option`; one with a default has a function of its name for the value that
/// counts. A row that begins with `required` must be given. Unknown keys are refused. What follows
/// the default changes the option's schema: see the functions of this module.
#[macro_export]
macro_rules! options {
    ($(#[$meta:meta])* pub struct $name:ident { $($rows:tt)* }) => {
        $crate::options!(@rows ($(#[$meta])* pub struct $name) () () $($rows)*);
    };
    (@rows $head:tt ($($fields:tt)*) $functions:tt
        $(#[$meta:meta])* required $key:ident: $type:ty $(, $fact:expr)*; $($rest:tt)*
    ) => {
        $crate::options!(@rows $head ($($fields)*
            $(#[$meta])*
            $(#[schemars(transform = $fact)])*
            pub $key: $type,
        ) $functions $($rest)*);
    };
    (@rows $head:tt ($($fields:tt)*) ($($functions:tt)*)
        $(#[$meta:meta])* $key:ident: $type:ty = $default:expr $(, $fact:expr)*; $($rest:tt)*
    ) => {
        $crate::options!(@rows $head ($($fields)*
            $(#[$meta])*
            #[serde(default, skip_serializing_if = "Option::is_none")]
            #[schemars(extend("default" = ({ let default: $type = $default; default })))]
            $(#[schemars(transform = $fact)])*
            pub $key: Option<$type>,
        ) ($($functions)*
            #[doc = concat!("The value of `", stringify!($key), "`, its default where none is given.")]
            pub fn $key(&self) -> $type {
                self.$key.as_ref().map_or_else(|| $default, ::std::clone::Clone::clone)
            }
        ) $($rest)*);
    };
    (@rows $head:tt ($($fields:tt)*) $functions:tt
        $(#[$meta:meta])* $key:ident: $type:ty $(, $fact:expr)*; $($rest:tt)*
    ) => {
        $crate::options!(@rows $head ($($fields)*
            $(#[$meta])*
            #[serde(default, skip_serializing_if = "Option::is_none")]
            $(#[schemars(transform = $fact)])*
            pub $key: Option<$type>,
        ) $functions $($rest)*);
    };
    (@rows ($(#[$meta:meta])* pub struct $name:ident) ($($fields:tt)*) ($($functions:tt)*)) => {
        #[derive(Debug, Clone, PartialEq)]
        #[derive(::serde::Serialize, ::serde::Deserialize, ::schemars::JsonSchema)]
        #[serde(deny_unknown_fields)]
        $(#[$meta])*
        pub struct $name { $($fields)* }

        impl $name { $($functions)* }
    };
}

/// Keyword of the schema: the unit of an option, for people.
pub const UNIT: &str = "x-unit";
/// Keyword of the schema: what an option does to the mean of the image, for people.
pub const EXPECTATION: &str = "x-expectation";

/// A keyword of the schema with its value.
pub fn keyword(name: &'static str, value: impl Into<Value>) -> impl FnMut(&mut Schema) {
    let value = value.into();
    move |schema| {
        schema.insert(name.into(), value.clone());
    }
}

/// A limit that is kept in single precision, as people write it: 0.001 itself is within "0.001 to
/// 1", which the same number in double precision, 0.0010000000474974513, would refuse.
pub fn written(limit: f32) -> f64 {
    limit.to_string().parse().unwrap_or_else(|_| f64::from(limit))
}

/// No smaller number than this.
pub fn at_least(limit: impl Into<Value>) -> impl FnMut(&mut Schema) {
    keyword("minimum", limit)
}

/// No larger number than this.
pub fn at_most(limit: impl Into<Value>) -> impl FnMut(&mut Schema) {
    keyword("maximum", limit)
}

/// Larger numbers than this.
pub fn above(limit: impl Into<Value>) -> impl FnMut(&mut Schema) {
    keyword("exclusiveMinimum", limit)
}

/// Smaller numbers than this.
pub fn below(limit: impl Into<Value>) -> impl FnMut(&mut Schema) {
    keyword("exclusiveMaximum", limit)
}

/// Numbers from the first to the second, both included.
pub fn between(low: impl Into<Value>, high: impl Into<Value>) -> impl FnMut(&mut Schema) {
    let (mut low, mut high) = (at_least(low), at_most(high));
    move |schema| {
        low(schema);
        high(schema);
    }
}

/// Texts that fit a regular expression.
pub fn pattern(pattern: &'static str) -> impl FnMut(&mut Schema) {
    keyword("pattern", pattern)
}

/// What may be written.
pub fn examples<const N: usize>(list: [Value; N]) -> impl FnMut(&mut Schema) {
    keyword("examples", list.to_vec())
}

/// What the numbers are counted in.
pub fn unit(unit: &'static str) -> impl FnMut(&mut Schema) {
    keyword(UNIT, unit)
}

/// The option changes the mean of the image: how, in words.
pub fn biased(how: &'static str) -> impl FnMut(&mut Schema) {
    keyword(EXPECTATION, format!("Biased: {how}."))
}

/// The option does not change the mean of the image: noise and time alone.
pub fn unbiased() -> impl FnMut(&mut Schema) {
    keyword(EXPECTATION, "Unbiased: the mean of the image does not depend on it.")
}
