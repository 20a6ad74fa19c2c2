//! Enumerations that messages hold as numbered constants.

/// Makes both halves of such a codec: the constant of each value, and the value of each constant.
macro_rules! numbered {
    (
        $(#[$to_doc:meta])* $to:ident, $(#[$of_doc:meta])* $of:ident,
        $type:ident { $($variant:ident = $number:path),+ $(,)? }
    ) => {
        $(#[$to_doc])*
        #[must_use]
        pub fn $to(value: $type) -> u8 {
            match value { $($type::$variant => $number),+ }
        }

        $(#[$of_doc])*
        #[must_use]
        pub fn $of(number: u8) -> Option<$type> {
            match number {
                $($number => Some($type::$variant),)+
                _ => None,
            }
        }
    };
}
pub(crate) use numbered;
