//! A table of settings, declared once. Its type, its default, its checks, the shipped file and the settings chapter
//! come from the same lines. Never does IO and never reads a clock.

#![forbid(clippy::disallowed_macros, clippy::disallowed_methods, clippy::disallowed_types)]

pub use serde;

/// A key of a table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Name in the file. Its last word is the unit.
    pub name: &'static str,
    /// The lines of its doc comment.
    pub meaning: &'static [&'static str],
    /// Lowest and highest value that is allowed. None if any value of the type is.
    pub bounds: Option<[f64; 2]>,
}

/// A type that [`table`] declared.
pub trait Table: Default + serde::Serialize {
    /// The lines of its doc comment.
    const MEANING: &'static [&'static str];
    /// Its keys, in the order of the file.
    const KEYS: &'static [Key];
}

/// Returned for a value outside its bounds.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{key} = {} is outside [{low}, {high}]", short(*.value))]
#[allow(missing_docs, reason = "the text names the fields")]
pub struct OutOfBounds {
    pub key: &'static str,
    pub value: f64,
    pub low: f64,
    pub high: f64,
}

/// Returns a number without the zeros of a very large or small one: 1e30 has 31 digits.
pub fn short(value: f64) -> String {
    let is_readable = value == 0.0 || (1e-6..1e15).contains(&value.abs());
    if is_readable { value.to_string() } else { format!("{value:e}") }
}

/// A value that bounds apply to.
pub trait Bounded {
    /// Returns the value as it is compared. None has nothing to compare.
    fn number(&self) -> Option<f64>;
}

impl Bounded for f64 {
    fn number(&self) -> Option<f64> {
        Some(*self)
    }
}

impl Bounded for u32 {
    fn number(&self) -> Option<f64> {
        Some(f64::from(*self))
    }
}

impl Bounded for Option<f64> {
    fn number(&self) -> Option<f64> {
        *self
    }
}

/// Checks one value. NaN is outside all bounds.
pub fn check(key: &'static str, value: &impl Bounded, low: f64, high: f64) -> Result<(), OutOfBounds> {
    match value.number() {
        Some(value) if !(low..=high).contains(&value) => Err(OutOfBounds { key, value, low, high }),
        _ => Ok(()),
    }
}

/// Declares a table of settings: `key: type = default, in [low, high];`. The bounds may be left out. A key that the file
/// does not know, or lacks, is refused when it is read.
///
/// ```
/// use schema::Table;
///
/// schema::table! {
///     /// The left arm.
///     pub struct Arm {
///         /// Longest stop, ms.
///         stop_time_ms: f64 = 250.0, in [0.0, 500.0];
///         /// Name of the arm.
///         name: String = "left".to_owned();
///     }
/// }
///
/// assert_eq!(Arm::KEYS[0].bounds, Some([0.0, 500.0]));
/// assert_eq!(Arm::default().check(), Ok(()));
/// let long = Arm { stop_time_ms: 501.0, ..Arm::default() };
/// assert_eq!(long.check().unwrap_err().to_string(), "stop_time_ms = 501 is outside [0, 500]");
/// ```
#[macro_export]
macro_rules! table {
    (
        $(#[doc = $about:literal])+
        $(#[derive($($derived:ident),*)])?
        pub struct $name:ident {
            $($(#[doc = $doc:literal])+ $(#[serde($($serde:tt)*)])? $key:ident: $kind:ty = $default:expr $(, in [$low:expr, $high:expr])?;)+
        }
    ) => {
        $(#[doc = $about])+
        #[derive(Clone, Debug, PartialEq, $crate::serde::Deserialize, $crate::serde::Serialize $($(, $derived)*)?)]
        #[serde(crate = "schema::serde", deny_unknown_fields)]
        pub struct $name {
            $(
                $(#[doc = $doc])+
                $(#[doc = concat!(" From ", stringify!($low), " to ", stringify!($high), ".")])?
                $(#[serde($($serde)*)])?
                pub $key: $kind,
            )+
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($key: $default),+ }
            }
        }

        impl $crate::Table for $name {
            const MEANING: &'static [&'static str] = &[$($about),+];
            const KEYS: &'static [$crate::Key] = &[$($crate::Key {
                name: stringify!($key),
                meaning: &[$($doc),+],
                bounds: $crate::table!(@bounds $($low, $high)?),
            }),+];
        }

        impl $name {
            /// Checks every value that has bounds.
            pub fn check(&self) -> Result<(), $crate::OutOfBounds> {
                $($($crate::check(stringify!($key), &self.$key, $low, $high)?;)?)+
                Ok(())
            }
        }
    };
    (@bounds) => { None };
    (@bounds $low:expr, $high:expr) => { Some([$low, $high]) };
}
