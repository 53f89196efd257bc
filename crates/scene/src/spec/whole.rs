//! Whole numbers in JSON, which may be written with a fraction of zero: 4.0 is 4, as in JSON
//! Schema.
//!
//! For `#[serde(deserialize_with = ...)]` on every whole number that people write.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{self, Unexpected, Visitor};
use serde::{Deserialize, Deserializer};

/// A type of whole numbers.
pub trait Whole: Sized {
    /// What is expected, for messages.
    const EXPECTED: &'static str;

    /// The number, if the type has it.
    fn from_wide(value: i128) -> Option<Self>;
}

macro_rules! whole {
    ($($number:ty: $expected:literal),*) => {$(
        impl Whole for $number {
            const EXPECTED: &'static str = $expected;

            fn from_wide(value: i128) -> Option<Self> {
                value.try_into().ok()
            }
        }
    )*};
}
whole!(
    u32: "a whole number from 0 to 4294967295",
    u64: "a whole number from 0 to 18446744073709551615",
    i64: "a whole number of at most 63 bits"
);

/// One number, for use in lists.
struct One<T>(T);

struct OneVisitor<T>(PhantomData<T>);

impl<T: Whole> Visitor<'_> for OneVisitor<T> {
    type Value = One<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(T::EXPECTED)
    }

    fn visit_u64<E: de::Error>(self, value: u64) -> Result<One<T>, E> {
        let wrong = || E::invalid_type(Unexpected::Unsigned(value), &self);
        T::from_wide(value.into()).map(One).ok_or_else(wrong)
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<One<T>, E> {
        let wrong = || E::invalid_type(Unexpected::Signed(value), &self);
        T::from_wide(value.into()).map(One).ok_or_else(wrong)
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<One<T>, E> {
        // The conversion saturates beyond 128 bits, where no type has the number.
        let whole = (value.fract() == 0.0).then_some(value as i128);
        let wrong = || E::invalid_type(Unexpected::Float(value), &self);
        whole.and_then(T::from_wide).map(One).ok_or_else(wrong)
    }
}

impl<'de, T: Whole> Deserialize<'de> for One<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(OneVisitor(PhantomData))
    }
}

/// A number.
///
/// # Errors
/// If there is something else, or the type does not have the number.
pub fn number<'de, D: Deserializer<'de>, T: Whole>(deserializer: D) -> Result<T, D::Error> {
    One::deserialize(deserializer).map(|One(value)| value)
}

/// A number or null.
///
/// # Errors
/// If there is something else, or the type does not have the number.
pub fn option<'de, D: Deserializer<'de>, T: Whole>(deserializer: D) -> Result<Option<T>, D::Error> {
    Ok(Option::<One<T>>::deserialize(deserializer)?.map(|One(value)| value))
}

/// Two numbers or null.
///
/// # Errors
/// If there is something else, another number of them, or one that the type does not have.
pub fn option_of_2<'de, D: Deserializer<'de>, T: Whole>(
    deserializer: D,
) -> Result<Option<[T; 2]>, D::Error> {
    Ok(Option::<[One<T>; 2]>::deserialize(deserializer)?.map(|list| list.map(|One(value)| value)))
}

/// Four numbers or null.
///
/// # Errors
/// If there is something else, another number of them, or one that the type does not have.
pub fn option_of_4<'de, D: Deserializer<'de>, T: Whole>(
    deserializer: D,
) -> Result<Option<[T; 4]>, D::Error> {
    Ok(Option::<[One<T>; 4]>::deserialize(deserializer)?.map(|list| list.map(|One(value)| value)))
}
