//! Enums whose variants have names in reports.

/// Declares an enum with the list of its variants and their names: `ALL`, `NAMES` and `name`.
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
}
