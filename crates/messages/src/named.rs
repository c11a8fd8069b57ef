//! Enums whose variants have names in reports, and meanings in words.

/// Declares an enum with the list of its variants and their names: `ALL`, `NAMES` and `name`. With a text behind each name,
/// also `meaning`, which is the documentation of the variant too.
#[macro_export]
macro_rules! named {
    ($(#[$meta:meta])* pub enum $Name:ident {
        $($(#[$doc:meta])* $variant:ident $(= $number:literal)? => $text:literal,)*
    }) => {
        $(#[$meta])*
        pub enum $Name { $($(#[$doc])* $variant $(= $number)?,)* }

        impl $Name {
            /// Every variant, in this order.
            pub const ALL: [Self; [$($text),*].len()] = [$(Self::$variant),*];

            /// Their names, in this order.
            pub const NAMES: [&'static str; Self::ALL.len()] = [$($text),*];

            /// Returns the name in reports.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $text,)* }
            }
        }
    };
    ($(#[$meta:meta])* pub enum $Name:ident {
        $($(#[$doc:meta])* $variant:ident $(= $number:literal)? => $text:literal: $meaning:literal,)*
    }) => {
        $crate::named! {
            $(#[$meta])*
            pub enum $Name { $(#[doc = $meaning] $(#[$doc])* $variant $(= $number)? => $text,)* }
        }

        impl $Name {
            /// Returns the meaning in words, for the user.
            pub const fn meaning(self) -> &'static str {
                match self { $(Self::$variant => $meaning,)* }
            }
        }
    };
}
