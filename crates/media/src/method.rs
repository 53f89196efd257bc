//! What is known of a method besides its code: its name, what it does, what to expect of it. One
//! row of one table per method; programs, documents and charts are made from these tables.

/// A choice among a fixed list, each with a name that people write.
pub trait Named: Copy + PartialEq + 'static {
    /// All of them, in the order in which they are listed.
    const ALL: &'static [Self];

    /// What the list is called: one or two words, joined, each with a capital.
    const TITLE: &'static str;

    /// What is chosen, in some words without a full stop: "How values between voxels are formed".
    const QUESTION: &'static str;

    /// Names of choices that formats have and this version does not know.
    const LATER: &'static [&'static str] = &[];

    /// The name: lower case, words joined by underscores.
    fn name(self) -> &'static str;

    /// What it is, in a sentence or two for users.
    fn about(self) -> &'static str;

    /// What the mean of its results is; `None` where that is no question.
    fn expectation(self) -> Option<Expectation> {
        None
    }

    /// The choice of a name; `None` if there is no such name.
    fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|choice| choice.name() == name)
    }
}

/// What stands for a choice that is left to the program.
const AUTO: &str = "auto";

/// The name of a choice, `auto` where it is left to the program.
pub fn name_or_auto<T: Named>(choice: Option<T>) -> &'static str {
    choice.map_or(AUTO, T::name)
}

/// The choice of a name, `Some(None)` for `auto`; `None` if there is no such name.
pub fn from_name_or_auto<T: Named>(name: &str) -> Option<Option<T>> {
    if name == AUTO { Some(None) } else { T::from_name(name).map(Some) }
}

/// What the mean of a method's results is, for a field whose bounds hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Expectation {
    /// The right value every time, but for rounding.
    Exact,
    /// The right value in the mean.
    Unbiased,
    /// Another value than the right one; in words, what is wrong with it.
    Biased(&'static str),
}

/// What the work of one call grows with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Work {
    /// The voxels that the ray crosses, whatever their values.
    Voxels,
    /// The optical depth of the majorants along the ray.
    MajorantDepth,
    /// A number of samples that is the method's own.
    Samples,
}

/// Under which transmittance functions a method is right.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transmittances {
    /// The exponential alone.
    Exponential,
    /// Mixtures of exponentials, by drawing a rate first.
    Mixtures,
    /// All of them.
    All,
}

/// What is known of a method besides its code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Facts {
    /// What the mean of its results is.
    pub expectation: Expectation,
    /// Whether it needs majorants that bound the extinction: it accepts collisions by probabilities
    /// or samples what is left above a minorant.
    pub needs_bounds: bool,
    /// What its work grows with.
    pub work: Work,
    /// Under which transmittance functions it is right.
    pub transmittances: Transmittances,
    /// On what it breaks, where bounds hold.
    pub weakness: &'static str,
    /// On what it breaks, where bounds do not hold.
    pub weakness_without_bounds: &'static str,
}

impl Facts {
    /// A method that is right every time, by walking voxel by voxel; under any transmittance
    /// function, since it knows the optical depth.
    pub(crate) const EXACT: Facts = Facts {
        expectation: Expectation::Exact,
        needs_bounds: false,
        work: Work::Voxels,
        transmittances: Transmittances::All,
        weakness: "exact but for rounding",
        weakness_without_bounds: "exact but for rounding",
    };

    /// A method that is right in the mean, with or without bounds; under mixtures of exponentials
    /// as well, which are right if each of their exponentials is.
    pub(crate) const fn unbiased(work: Work) -> Facts {
        Facts {
            expectation: Expectation::Unbiased,
            needs_bounds: false,
            work,
            transmittances: Transmittances::Mixtures,
            weakness: "",
            weakness_without_bounds: "",
        }
    }

    /// A method of a fixed number of samples that is wrong in the mean: `how`, in words.
    pub(crate) const fn biased(how: &'static str) -> Facts {
        Facts {
            expectation: Expectation::Biased(how),
            transmittances: Transmittances::Exponential,
            ..Facts::unbiased(Work::Samples)
        }
    }

    /// It is right where bounds hold only.
    pub(crate) const fn needs_bounds(self) -> Facts {
        Facts { needs_bounds: true, ..self }
    }

    /// It is right under these transmittance functions.
    pub(crate) const fn under(self, transmittances: Transmittances) -> Facts {
        Facts { transmittances, ..self }
    }

    /// On what it breaks, bounds or not.
    pub(crate) const fn breaks(self, weakness: &'static str) -> Facts {
        Facts { weakness, weakness_without_bounds: weakness, ..self }
    }

    /// On what it breaks where bounds do not hold; after [`Facts::breaks`].
    pub(crate) const fn breaks_without_bounds(self, weakness: &'static str) -> Facts {
        Facts { weakness_without_bounds: weakness, ..self }
    }
}

/// Makes an enum of methods from a table: a row has what users are told, the variant with its name,
/// what is known of it, and the code that runs it.
macro_rules! methods {
    (
        $(#[$meta:meta])*
        pub enum $Methods:ident called $title:literal, $question:literal;

        $(#[$run_meta:meta])*
        pub fn $run:ident[$($generics:tt)*]($($arg:ident: $type:ty),* $(,)?) -> $result:ty;

        $($(#[doc = $about:literal])+ $Variant:ident = $name:literal, $facts:expr => $code:expr;)+
    ) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum $Methods {
            $($(#[doc = $about])+ $Variant,)+
        }

        impl $Methods {
            /// All of them, in the order in which they are listed.
            pub const ALL: [$Methods; [$($name),+].len()] = [$($Methods::$Variant),+];

            /// The name that people write.
            pub const fn name(self) -> &'static str {
                match self { $($Methods::$Variant => $name,)+ }
            }

            /// The method of a name; `None` if there is no such name.
            pub fn from_name(name: &str) -> Option<$Methods> {
                $Methods::ALL.into_iter().find(|method| method.name() == name)
            }

            /// What is known of it besides its code.
            pub const fn facts(self) -> $crate::method::Facts {
                use $crate::method::{Facts, Transmittances, Work};
                match self { $($Methods::$Variant => $facts,)+ }
            }

            /// Whether the mean of its results is right, for a field whose bounds hold.
            pub const fn is_unbiased(self) -> bool {
                !matches!(self.facts().expectation, $crate::method::Expectation::Biased(_))
            }

            $(#[$run_meta])*
            pub fn $run<$($generics)*>(self, $($arg: $type),*) -> $result {
                match self { $($Methods::$Variant => $code,)+ }
            }
        }

        impl $crate::method::Named for $Methods {
            const ALL: &'static [$Methods] = &$Methods::ALL;
            const TITLE: &'static str = $title;
            const QUESTION: &'static str = $question;

            fn name(self) -> &'static str {
                $Methods::name(self)
            }

            fn about(self) -> &'static str {
                match self { $($Methods::$Variant => concat!($($about),+).trim_ascii_start(),)+ }
            }

            fn expectation(self) -> Option<$crate::method::Expectation> {
                Some(self.facts().expectation)
            }
        }
    };
}
pub(crate) use methods;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distance::DistanceSampler;
    use crate::grid::Interpolation;
    use crate::transmittance::Estimator;

    fn names_are_distinct<T: Named + std::fmt::Debug>() {
        for choice in T::ALL {
            assert_eq!(T::from_name(choice.name()), Some(*choice));
            assert!(choice.about().ends_with('.') && !choice.about().starts_with(' '));
        }
        assert_eq!(T::from_name("none"), None);
        assert_eq!(from_name_or_auto::<T>("auto"), Some(None));
        assert_eq!(from_name_or_auto::<T>("none"), None);
        assert_eq!(name_or_auto(None::<T>), "auto");
    }

    #[test]
    fn names_lead_back_to_their_methods() {
        names_are_distinct::<Estimator>();
        names_are_distinct::<DistanceSampler>();
        names_are_distinct::<Interpolation>();
    }

    #[test]
    fn every_method_says_on_what_it_breaks() {
        let estimators = Estimator::ALL.map(|method| (method.name(), method.facts()));
        let samplers = DistanceSampler::ALL.map(|method| (method.name(), method.facts()));
        for (name, facts) in estimators.into_iter().chain(samplers) {
            assert!(!facts.weakness.is_empty(), "{name}");
            assert!(!facts.weakness_without_bounds.is_empty(), "{name}");
        }
    }
}
