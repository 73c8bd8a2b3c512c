//! What messages of both directions share: how they are written and read, and their parts.

use core::fmt;

use serde::{Deserialize, Serialize};

use crate::pack::{self, Packed, Sample, Values};

/// A message of one direction.
pub trait Message<'a>: Sized {
    /// The number of its kind, which no other kind of either direction has.
    #[must_use]
    fn kind(&self) -> u8;

    /// Writes the body.
    ///
    /// # Errors
    /// [`WriteError`] if it does not fit.
    fn write(&self, body: &mut Body<'_>) -> Result<(), WriteError>;

    /// Reads the body of a message of this kind.
    ///
    /// # Errors
    /// [`ReadError`] if there is no such kind, or the body is not one.
    fn read(kind: u8, body: &'a [u8]) -> Result<Self, ReadError>;
}

/// Why a body was not written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WriteError {
    /// The memory is smaller than the message.
    Memory,
    /// A line has more than 65535 values, or the bytes of two views are not of one length.
    Line,
}

/// Why a body was not read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReadError {
    /// There is no such kind of message in this direction.
    Unknown,
    /// The body is not that of a message of this kind.
    Malformed,
}

/// Memory that a body is written to.
#[derive(Debug)]
pub struct Body<'b> {
    bytes: &'b mut [u8],
    length: usize,
}

impl<'b> Body<'b> {
    /// An empty body in these bytes.
    pub(crate) fn new(bytes: &'b mut [u8]) -> Self {
        Self { bytes, length: 0 }
    }

    /// Number of bytes written.
    pub(crate) fn length(&self) -> usize {
        self.length
    }

    fn free(&mut self) -> &mut [u8] {
        self.bytes.get_mut(self.length..).unwrap_or_default()
    }

    /// Appends fields as postcard writes them.
    pub(crate) fn fields<T: Serialize>(&mut self, fields: &T) -> Result<(), WriteError> {
        let written = postcard::to_slice(fields, self.free()).map_err(|_| WriteError::Memory)?;
        self.length += written.len();
        Ok(())
    }

    /// Appends bytes as they are.
    pub(crate) fn bytes(&mut self, bytes: &[u8]) -> Result<(), WriteError> {
        let place = self.free().get_mut(..bytes.len());
        place.ok_or(WriteError::Memory)?.copy_from_slice(bytes);
        self.length += bytes.len();
        Ok(())
    }

    /// Appends the number of values and the values, packed.
    pub(crate) fn values<T: Sample>(&mut self, values: &Values<'_, T>) -> Result<(), WriteError> {
        let count = u16::try_from(values.count()).map_err(|_| WriteError::Line)?;
        self.fields(&count)?;
        match values {
            Values::Plain(values) => {
                let taken = pack::pack(values, self.free()).ok_or(WriteError::Memory)?;
                self.length += taken;
                Ok(())
            }
            Values::Packed(packed) => self.bytes(packed.bytes()),
        }
    }
}

/// Reads fields and returns the bytes after them.
pub(crate) fn fields<'a, T: Deserialize<'a>>(body: &'a [u8]) -> Result<(T, &'a [u8]), ReadError> {
    postcard::take_from_bytes(body).map_err(|_| ReadError::Malformed)
}

/// Reads a body that has fields alone.
pub(crate) fn only_fields<'a, T: Deserialize<'a>>(body: &'a [u8]) -> Result<T, ReadError> {
    let (read, rest) = fields(body)?;
    if rest.is_empty() {
        Ok(read)
    } else {
        Err(ReadError::Malformed)
    }
}

/// Reads the number of values and the values, which end a body.
pub(crate) fn values<T: Sample>(body: &[u8]) -> Result<Values<'_, T>, ReadError> {
    let (count, bytes) = fields(body)?;
    Ok(Values::Packed(Packed::new(count, bytes)))
}

/// A line of values of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Line<'a, T> {
    /// Number of the frame.
    pub frame: u32,
    /// Number of the line in the frame, from 0.
    pub line: u32,
    /// Column of the frame that the first value belongs to.
    pub column: u16,
    /// The values from that column to the right.
    pub values: Values<'a, T>,
}

impl<'a, T: Sample> Line<'a, T> {
    pub(crate) fn write(&self, body: &mut Body<'_>) -> Result<(), WriteError> {
        body.fields(&(self.frame, self.line, self.column))?;
        body.values(&self.values)
    }

    pub(crate) fn read(body: &'a [u8]) -> Result<Self, ReadError> {
        let ((frame, line, column), rest) = fields(body)?;
        Ok(Self {
            frame,
            line,
            column,
            values: values(rest)?,
        })
    }
}

/// Format of the pixels of a camera's lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum PixelFormat {
    /// One byte per pixel, 0 black to 255 white.
    Grey8,
    /// Three bytes per pixel: red, green, blue.
    Rgb888,
    /// Two bytes per pixel, the high byte first: 5 bits of red, 6 of green, 5 of blue.
    Rgb565,
    /// Two bytes per pixel, `Y0 U Y1 V`: a luma byte, then U of even or V of odd pixels.
    Yuv422,
}

impl PixelFormat {
    /// Bytes of a line of `width_px` pixels of one view.
    #[must_use]
    pub const fn line_bytes(self, width_px: u16) -> usize {
        let bytes_per_pixel = match self {
            Self::Grey8 => 1,
            Self::Rgb565 | Self::Yuv422 => 2,
            Self::Rgb888 => 3,
        };
        width_px as usize * bytes_per_pixel
    }
}

/// A rectangle of a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Region {
    /// First column, px.
    pub x_px: u16,
    /// First line.
    pub y_lines: u32,
    /// Number of columns, px.
    pub width_px: u16,
    /// Number of lines.
    pub height_lines: u32,
}

/// A set of streams.
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Streams(u16);

impl Streams {
    /// Pairs of lines as the camera delivers them.
    pub const RAW: Self = Self(1);
    /// Rectified pairs of lines.
    pub const RECTIFIED: Self = Self(1 << 1);
    /// Lines of disparities.
    pub const DISPARITIES: Self = Self(1 << 2);
    /// Lines of confidences.
    pub const CONFIDENCES: Self = Self(1 << 3);
    /// Lines of depths.
    pub const DEPTHS: Self = Self(1 << 4);
    /// Lines of points.
    pub const POINTS: Self = Self(1 << 5);
    /// Laser scans.
    pub const SCANS: Self = Self(1 << 6);
    /// None of them.
    pub const NONE: Self = Self(0);

    /// The streams that have a name.
    pub const NAMED: [(&'static str, Self); 7] = [
        ("raw", Self::RAW),
        ("rectified", Self::RECTIFIED),
        ("disparities", Self::DISPARITIES),
        ("confidences", Self::CONFIDENCES),
        ("depths", Self::DEPTHS),
        ("points", Self::POINTS),
        ("scans", Self::SCANS),
    ];

    /// The set of these bits. Bits without a name are kept.
    #[must_use]
    pub const fn from_bits(bits: u16) -> Self {
        Self(bits)
    }

    /// The bits of the set.
    #[must_use]
    pub const fn bits(self) -> u16 {
        self.0
    }

    /// The streams of both sets.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Whether all streams of `other` are in this set.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

impl fmt::Debug for Streams {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let named = Self::NAMED
            .into_iter()
            .filter(|(_, one)| self.contains(*one));
        f.debug_set().entries(named.map(|(name, _)| name)).finish()
    }
}

/// Implements conversion of an enum to and from the byte that is sent, with a variant for bytes that
/// have no meaning yet.
macro_rules! byte_enum {
    ($(#[$attributes:meta])* $name:ident, else $other:ident, { $($(#[$docs:meta])* $variant:ident = $byte:literal,)* }) => {
        $(#[$attributes])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
        #[serde(from = "u8", into = "u8")]
        pub enum $name {
            $($(#[$docs])* $variant,)*
        }

        impl $name {
            /// All of them.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)*];
        }

        impl From<u8> for $name {
            fn from(byte: u8) -> Self {
                match byte {
                    $($byte => Self::$variant,)*
                    _ => Self::$other,
                }
            }
        }

        impl From<$name> for u8 {
            fn from(value: $name) -> Self {
                match value {
                    $($name::$variant => $byte,)*
                }
            }
        }
    };
}
pub(crate) use byte_enum;
