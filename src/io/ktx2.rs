//! KTX2 files of uncompressed textures with layers: 3D textures and 2D arrays of RGBA, 8 bits each.
//!
//! Source: Khronos Texture File Format Specification 2.0; Khronos Data Format Specification 1.3 for the descriptor.
//! In: the samples of every layer at every mip level. Out: the bytes of a file; of any such file what its header says.
//! Levels are stored smallest first, aligned to a texel; sRGB stands both in the format and in the descriptor. The mips of
//! a 3D texture would halve its layers as well, and mix materials: it has none here, and who wants mips takes an array.
//! Unaware of: what the texture shows, how mips are made.

/// What kind of texture layers make.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// A 3D texture, filtered between layers by the GPU. One level.
    Volume,
    /// A 2D array, whose reader filters between layers.
    Array,
}

/// A texture of several layers.
#[derive(Clone, Debug, PartialEq)]
pub struct LayeredTexture {
    /// Texels per row of the first level.
    pub width: u32,
    /// Rows of the first level.
    pub height: u32,
    /// Layers, at least one.
    pub layers: u32,
    /// Whether red, green and blue are sRGB; alpha never is.
    pub srgb: bool,
    /// What the layers make.
    pub shape: Shape,
    /// The samples of each level, largest first: RGBA of its texels row by row, layer by layer. Sides halve from
    /// level to level, rounded down, and are at least 1. At least one level; exactly one of a volume.
    pub levels: Vec<Vec<u8>>,
}

const IDENTIFIER: [u8; 12] = [0xab, b'K', b'T', b'X', b' ', b'2', b'0', 0xbb, b'\r', b'\n', 0x1a, b'\n'];
const VK_FORMAT_R8G8B8A8_UNORM: u32 = 37;
const VK_FORMAT_R8G8B8A8_SRGB: u32 = 43;
/// Identifier, header, index without its levels.
const FIXED: usize = 80;
/// Bytes of a level's entry in the index.
const LEVEL_ENTRY: usize = 24;

/// What a file's header says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ktx2Header {
    /// Number of the format, as Vulkan counts them; 0: of none of these.
    pub format: u32,
    /// Texels per row of the first level.
    pub width: u32,
    /// Rows of the first level; 0 of a texture with one axis.
    pub height: u32,
    /// Layers of a 3D texture; 0: it is none.
    pub depth: u32,
    /// Layers of an array; 0: it is none.
    pub layers: u32,
    /// Faces: 6 of a cube, else 1.
    pub faces: u32,
    /// Levels in the file; 0 asks the reader to make all below the first.
    pub levels: u32,
}

impl Ktx2Header {
    /// Of a file that starts as a KTX2 file does; `None`: it does not.
    pub fn read(bytes: &[u8]) -> Option<Self> {
        let words = bytes.strip_prefix(&IDENTIFIER)?.first_chunk::<32>()?;
        let word = |i: usize| u32::from_le_bytes([0, 1, 2, 3].map(|b| words[4 * i + b]));
        let [format, width, height, depth] = [0, 2, 3, 4].map(word);
        let [layers, faces, levels] = [5, 6, 7].map(word);
        Some(Ktx2Header { format, width, height, depth, layers, faces, levels })
    }

    /// Whether red, green and blue are sRGB, of the formats that are written here; `None`: of another format.
    pub fn is_srgb(&self) -> Option<bool> {
        match self.format {
            VK_FORMAT_R8G8B8A8_UNORM => Some(false),
            VK_FORMAT_R8G8B8A8_SRGB => Some(true),
            _ => None,
        }
    }
}

/// Why a texture is no KTX2 file.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Ktx2Error {
    /// A level has another number of bytes than its size says, or there are too few or too many levels.
    Level {
        /// The level, 0 the largest.
        level: usize,
        /// Its bytes.
        found: usize,
        /// The bytes that it should have; 0 if it should not be there.
        expected: u64,
    },
}

impl std::fmt::Display for Ktx2Error {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Ktx2Error::Level { level, found, expected } => {
                write!(f, "level {level} of a texture has {found} bytes, expected {expected}")
            }
        }
    }
}

impl std::error::Error for Ktx2Error {}

/// The bytes of a file.
pub fn write_ktx2(texture: &LayeredTexture) -> Result<Vec<u8>, Ktx2Error> {
    let LayeredTexture { width, height, layers, srgb, shape, levels } = texture;
    check(texture)?;
    let (descriptor, values) = (descriptor(*srgb), values(*shape));
    let format = if *srgb { VK_FORMAT_R8G8B8A8_SRGB } else { VK_FORMAT_R8G8B8A8_UNORM };
    let [depth, array] = match shape {
        Shape::Volume => [*layers, 0],
        Shape::Array => [0, *layers],
    };
    let descriptor_at = FIXED + LEVEL_ENTRY * levels.len();
    let values_at = descriptor_at + descriptor.len();
    let mut out = IDENTIFIER.to_vec();
    let words = |out: &mut Vec<u8>, words: &[u32]| words.iter().for_each(|w| out.extend(w.to_le_bytes()));
    // Format, size of a type, sides, layers, faces, levels, no supercompression; then where descriptor and values are.
    words(&mut out, &[format, 1, *width, *height, depth, array, 1, levels.len() as u32, 0]);
    words(&mut out, &[descriptor_at as u32, descriptor.len() as u32, values_at as u32, values.len() as u32]);
    out.extend([0u8; 16]);
    // A multiple of four already: every part before is.
    let mut at = (values_at + values.len()) as u64;
    let mut entries = Vec::new();
    for level in levels.iter().rev() {
        entries.push([at, level.len() as u64, level.len() as u64]);
        at += level.len() as u64;
    }
    entries.iter().rev().flatten().for_each(|n| out.extend(n.to_le_bytes()));
    out.extend(descriptor);
    out.extend(values);
    levels.iter().rev().for_each(|level| out.extend(level));
    Ok(out)
}

fn check(texture: &LayeredTexture) -> Result<(), Ktx2Error> {
    let most = match texture.shape {
        Shape::Volume => 1,
        Shape::Array => 1 + texture.width.max(texture.height).max(1).ilog2() as usize,
    };
    if texture.levels.is_empty() {
        return Err(Ktx2Error::Level { level: 0, found: 0, expected: 4 });
    }
    for (level, bytes) in texture.levels.iter().enumerate() {
        let side = |n: u32| u64::from((n >> level.min(31)).max(1));
        let wanted = 4 * side(texture.width) * side(texture.height) * u64::from(texture.layers);
        let expected = if level < most { wanted } else { 0 };
        if bytes.len() as u64 != expected {
            return Err(Ktx2Error::Level { level, found: bytes.len(), expected });
        }
    }
    Ok(())
}

/// The data format descriptor of RGBA with 8 bits each: one basic block with four samples.
fn descriptor(srgb: bool) -> Vec<u8> {
    const MODEL_RGBSDA: u32 = 1;
    const PRIMARIES_BT709: u32 = 1;
    const TRANSFER: [u32; 2] = [1, 2];
    /// Alpha that is linear though the rest is not.
    const LINEAR: u32 = 0x10;
    let block = 24 + 4 * 16;
    let mut words = vec![4 + block, 0, 2 | (block << 16)];
    words.push(MODEL_RGBSDA | (PRIMARIES_BT709 << 8) | (TRANSFER[usize::from(srgb)] << 16));
    // A block of one texel, four bytes in the first plane.
    words.extend([0, 4, 0]);
    for (i, channel) in [0, 1, 2, 15 | (if srgb { LINEAR } else { 0 })].into_iter().enumerate() {
        words.extend([(8 * i as u32) | (7 << 16) | (channel << 24), 0, 0, 255]);
    }
    words.into_iter().flat_map(u32::to_le_bytes).collect()
}

/// Keys and values: rows run down, layers away from the viewer.
fn values(shape: Shape) -> Vec<u8> {
    let orientation = match shape {
        Shape::Volume => "rdi",
        Shape::Array => "rd",
    };
    let mut out = Vec::new();
    for (key, value) in [("KTXorientation", orientation), ("KTXwriter", "kiln")] {
        let pair = [key.as_bytes(), &[0], value.as_bytes(), &[0]].concat();
        out.extend((pair.len() as u32).to_le_bytes());
        out.extend(&pair);
        out.resize(out.len().next_multiple_of(4), 0);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn word(file: &[u8], at: usize) -> u32 {
        u32::from_le_bytes([0, 1, 2, 3].map(|i| file[at + i]))
    }

    fn array() -> LayeredTexture {
        let level = |w: usize, h: usize, from: u8| (0..4 * w * h * 3).map(|i| from + i as u8).collect::<Vec<u8>>();
        let levels = vec![level(5, 2, 0), level(2, 1, 130), level(1, 1, 200)];
        LayeredTexture { width: 5, height: 2, layers: 3, srgb: true, shape: Shape::Array, levels }
    }

    #[test]
    fn levels_are_found_by_the_index_and_stored_smallest_first() {
        let texture = array();
        let file = write_ktx2(&texture).expect("a file");
        assert_eq!(file[..12], IDENTIFIER);
        let header: Vec<u32> = (0..9).map(|i| word(&file, 12 + 4 * i)).collect();
        assert_eq!(header, [VK_FORMAT_R8G8B8A8_SRGB, 1, 5, 2, 0, 3, 1, 3, 0]);
        let read = Ktx2Header { format: 43, width: 5, height: 2, depth: 0, layers: 3, faces: 1, levels: 3 };
        assert_eq!((Ktx2Header::read(&file), read.is_srgb()), (Some(read), Some(true)));
        assert!(Ktx2Header::read(&file[..40]).is_none() && Ktx2Header::read(&file[1..]).is_none());
        let mut ends = Vec::new();
        for (i, level) in texture.levels.iter().enumerate() {
            let [at, len] = [0, 8].map(|j| word(&file, 80 + 24 * i + j) as usize);
            assert_eq!((len, &file[at..at + len]), (level.len(), &level[..]));
            assert!(at.is_multiple_of(4));
            ends.push(at);
        }
        assert!(ends.windows(2).all(|w| w[0] > w[1]));
        assert_eq!(ends[0] + texture.levels[0].len(), file.len());
    }

    #[test]
    fn the_descriptor_says_what_the_format_says() {
        for (srgb, format, transfer, alpha) in [(true, 43, 2, 0x1f), (false, 37, 1, 0x0f)] {
            let texture =
                LayeredTexture { srgb, shape: Shape::Volume, levels: vec![array().levels[0].clone()], ..array() };
            let file = write_ktx2(&texture).expect("a file");
            assert_eq!((word(&file, 12), word(&file, 28), word(&file, 32)), (format, 3, 0));
            let (at, len) = (word(&file, 48) as usize, word(&file, 52) as usize);
            assert_eq!((at, len, word(&file, at) as usize), (80 + 24, 4 + 24 + 64, len));
            assert_eq!(word(&file, at + 8), 2 | (88 << 16));
            assert_eq!((file[at + 12], file[at + 13], file[at + 14], file[at + 20]), (1, 1, transfer, 4));
            let channels: Vec<u8> = (0..4).map(|i| file[at + 28 + 16 * i + 3]).collect();
            assert_eq!(channels, [0, 1, 2, alpha]);
            let values = &file[word(&file, 56) as usize..][..word(&file, 60) as usize];
            assert_eq!(values, b"\x13\0\0\0KTXorientation\0rdi\0\0\x0f\0\0\0KTXwriter\0kiln\0\0");
        }
    }

    #[test]
    fn levels_of_the_wrong_size_are_refused() {
        let fails = |change: &dyn Fn(&mut LayeredTexture)| {
            let mut texture = array();
            change(&mut texture);
            write_ktx2(&texture).map_err(|e| e.to_string()).expect_err("refused")
        };
        assert_eq!(fails(&|t| t.levels[1].truncate(20)), "level 1 of a texture has 20 bytes, expected 24");
        assert_eq!(fails(&|t| t.levels.push(vec![0; 12])), "level 3 of a texture has 12 bytes, expected 0");
        assert_eq!(fails(&|t| t.shape = Shape::Volume), "level 1 of a texture has 24 bytes, expected 0");
        assert_eq!(fails(&|t| t.levels.clear()), "level 0 of a texture has 0 bytes, expected 4");
    }
}
