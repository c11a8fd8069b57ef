//! Layouts that check themselves. A hash over names, types, offsets and sizes is part of the shared-memory type
//! name. The transport alone would not notice that two fields of equal size changed places.

/// One field of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Field name.
    pub name: &'static str,
    /// Type as written in the source.
    pub ty: &'static str,
    /// Offset in bytes.
    pub offset: usize,
    /// Size in bytes.
    pub size: usize,
}

/// A type with a fixed memory layout and a hash of that layout.
pub trait Layout: Copy {
    /// FNV-1a hash of the whole layout, nested types included.
    const HASH: u64;
    /// The value with every number zero.
    const ZERO: Self;
    /// Writes the value into the first `size_of::<Self>()` bytes of `out`, numbers little-endian. Further bytes
    /// keep their value. If `out` is too short, a number that does not fit is not written at all.
    fn write_to(&self, out: &mut [u8]);
    /// Returns the value whose bytes [`Layout::write_to`] wrote. A number with missing bytes is zero.
    fn get(bytes: &[u8]) -> Self;
}

/// A message: a layout with a name, a version and a list of fields.
pub trait Message: Layout + Send + Sync + 'static {
    /// Type name without namespace.
    const NAME: &'static str;
    /// Layout version.
    const VERSION: u32;
    /// Fields in memory order.
    const FIELDS: &'static [Field];
    /// Name by which the transport knows the type: `teleop.<name>.v<version>.<hash>`.
    const TYPE_NAME: TypeName = TypeName::new(Self::NAME, Self::VERSION, Self::HASH);

    /// Decodes bytes that [`Layout::write_to`] wrote. Returns `None` if their number is not the message's size. All bit
    /// patterns are valid values of the type. The reader must check whether the values make sense.
    fn from_le_bytes(bytes: &[u8]) -> Option<Self> {
        (bytes.len() == size_of::<Self>()).then(|| Self::get(bytes))
    }
}

/// Returns the bytes from `offset` on. Empty if there are none.
pub(crate) fn tail(bytes: &[u8], offset: usize) -> &[u8] {
    bytes.get(offset..).unwrap_or_default()
}

/// See [`tail`].
pub(crate) fn tail_mut(bytes: &mut [u8], offset: usize) -> &mut [u8] {
    bytes.get_mut(offset..).unwrap_or_default()
}

/// A string built at compile time.
#[derive(Clone, Copy, Debug)]
pub struct TypeName {
    bytes: [u8; 96],
    len: usize,
}

impl TypeName {
    const fn new(name: &str, version: u32, hash: u64) -> Self {
        let mut out = Self { bytes: [0; 96], len: 0 };
        out = out.push("teleop.").push(name).push(".v").push_digits(version as u64, 10, 1).push(".");
        out.push_digits(hash, 16, 16)
    }

    const fn push(mut self, text: &str) -> Self {
        let text = text.as_bytes();
        let mut i = 0;
        while i < text.len() {
            self.bytes[self.len] = text[i];
            self.len += 1;
            i += 1;
        }
        self
    }

    const fn push_digits(mut self, value: u64, base: u64, width: usize) -> Self {
        let mut digits = width;
        let mut rest = value;
        let mut needed = 0;
        while rest > 0 {
            rest /= base;
            needed += 1;
        }
        if needed > digits {
            digits = needed;
        }
        let mut rest = value;
        let mut i = digits;
        while i > 0 {
            i -= 1;
            self.bytes[self.len + i] = b"0123456789abcdef"[(rest % base) as usize];
            rest /= base;
        }
        self.len += digits;
        self
    }

    /// The name as text.
    pub const fn as_str(&self) -> &str {
        match core::str::from_utf8(self.bytes.split_at(self.len).0) {
            Ok(text) => text,
            Err(_) => "teleop.invalid",
        }
    }
}

/// FNV-1a, 64 bit (offset basis and prime as published by Fowler, Noll and Vo).
pub const fn fnv(mut hash: u64, bytes: &[u8]) -> u64 {
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(0x0000_0100_0000_01b3);
        i += 1;
    }
    hash
}

/// Hash of no bytes.
pub const FNV_BASIS: u64 = 0xcbf2_9ce4_8422_2325;

macro_rules! primitive {
    ($($t:ty),*) => {$(
        impl Layout for $t {
            const HASH: u64 = fnv(FNV_BASIS, stringify!($t).as_bytes());
            const ZERO: Self = 0 as $t;
            fn write_to(&self, out: &mut [u8]) {
                if let Some(place) = out.first_chunk_mut() {
                    *place = self.to_le_bytes();
                }
            }
            fn get(bytes: &[u8]) -> Self {
                bytes.first_chunk().map_or(Self::ZERO, |bytes| Self::from_le_bytes(*bytes))
            }
        }
    )*};
}
primitive!(u8, u32, u64, i64, f32, f64);

impl<T: Layout, const N: usize> Layout for [T; N] {
    const HASH: u64 = fnv(fnv(T::HASH, b"array"), &(N as u64).to_le_bytes());
    const ZERO: Self = [T::ZERO; N];
    fn write_to(&self, out: &mut [u8]) {
        for (i, value) in self.iter().enumerate() {
            value.write_to(tail_mut(out, i * size_of::<T>()));
        }
    }
    fn get(bytes: &[u8]) -> Self {
        core::array::from_fn(|i| T::get(tail(bytes, i * size_of::<T>())))
    }
}

/// Declares a message: the struct, its layout hash, its field table, and the proof that it holds no padding.
macro_rules! message {
    ($(#[$meta:meta])* pub struct $name:ident v $version:literal size $size:literal {
        $($(#[$fmeta:meta])* pub $field:ident: $ty:ty,)*
    }) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name { $($(#[$fmeta])* pub $field: $ty,)* }

        impl $crate::Layout for $name {
            const HASH: u64 = {
                let mut hash = $crate::layout::fnv($crate::layout::FNV_BASIS, stringify!($name).as_bytes());
                $(
                    hash = $crate::layout::fnv(hash, stringify!($field).as_bytes());
                    hash = $crate::layout::fnv(hash, &(core::mem::offset_of!($name, $field) as u64).to_le_bytes());
                    hash = $crate::layout::fnv(hash, &<$ty as $crate::Layout>::HASH.to_le_bytes());
                )*
                hash
            };
            const ZERO: Self = Self { $($field: <$ty as $crate::Layout>::ZERO,)* };
            fn write_to(&self, out: &mut [u8]) {
                $($crate::Layout::write_to(
                    &self.$field,
                    $crate::layout::tail_mut(out, core::mem::offset_of!($name, $field)),
                );)*
            }
            fn get(bytes: &[u8]) -> Self {
                Self { $($field: $crate::Layout::get(
                    $crate::layout::tail(bytes, core::mem::offset_of!($name, $field)),
                ),)* }
            }
        }

        impl Default for $name {
            fn default() -> Self {
                <Self as $crate::Layout>::ZERO
            }
        }

        impl $crate::Message for $name {
            const NAME: &'static str = stringify!($name);
            const VERSION: u32 = $version;
            const FIELDS: &'static [$crate::Field] = &[$($crate::Field {
                name: stringify!($field),
                ty: stringify!($ty),
                offset: core::mem::offset_of!($name, $field),
                size: core::mem::size_of::<$ty>(),
            },)*];
        }

        const _: () = {
            let filled = 0 $(+ core::mem::size_of::<$ty>())*;
            assert!(filled == core::mem::size_of::<$name>(), "a message holds no padding");
            assert!($size == core::mem::size_of::<$name>(), "the size of a message is part of its contract");
        };
    };
}
pub(crate) use message;
