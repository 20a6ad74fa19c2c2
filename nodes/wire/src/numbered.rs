//! Enumerations that messages hold as numbered constants.

/// A number that stands for nothing that this version knows.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field} = {found}, allowed are {allowed}")]
pub struct UnknownNumber {
    /// The field of the message.
    pub field: &'static str,
    /// What it holds.
    pub found: i64,
    /// The range of the constants.
    pub allowed: &'static str,
}

/// Makes both halves of such a codec: the constant of each value, and the value of each constant. The field's name and
/// the range of its constants are for the error.
macro_rules! numbered {
    (
        $(#[$to_doc:meta])* $to_vis:vis $to:ident, $(#[$of_doc:meta])* $of_vis:vis $of:ident,
        $field:literal, $allowed:literal,
        $type:ident as $number_type:ty { $($variant:ident = $number:path),+ $(,)? }
    ) => {
        $(#[$to_doc])*
        #[must_use]
        $to_vis fn $to(value: $type) -> $number_type {
            match value { $($type::$variant => $number),+ }
        }

        $(#[$of_doc])*
        $of_vis fn $of(number: $number_type) -> Result<$type, $crate::numbered::UnknownNumber> {
            match number {
                $($number => Ok($type::$variant),)+
                found => Err($crate::numbered::UnknownNumber {
                    field: $field,
                    found: found.into(),
                    allowed: $allowed,
                }),
            }
        }
    };
}
pub(crate) use numbered;
