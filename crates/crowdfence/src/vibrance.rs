//! Vibrance: weak colours become stronger, strong ones stay, grey stays grey.
//!
//! Real cameras show paler colours than renderers. A network that was trained on rendered pictures is shown theirs
//! with the colour of every pixel (its difference from its brightness) times a factor that falls from `gain` for the
//! palest to 1 for a colour of half the range, so that nothing is driven out of the range of the pixels.

use crate::error::{Error, Result, require};

/// Brightness of red, green and blue (ITU-R BT.601).
const LUMA: [f32; 3] = [0.299, 0.587, 0.114];
/// A colour this far from its brightness is left as it is.
const STRONG: f32 = 128.0;
/// Pixels whose channels lie beside each other at a time: the compiler makes vectors of loops over them.
const BLOCK: usize = 64;

/// Changes pixels, red, green and blue after each other, in place; `gain` is 1 to 8, and 1 leaves them alone.
///
/// With y the brightness of a pixel, d the differences of its channels from y and c the largest of them, each becomes
/// y + d gain / (1 + (gain - 1) c / 128), rounded, and cut off at 0 and 255.
pub fn vibrant(pixels: &mut [u8], gain: f32) -> Result<()> {
    require((1.0..=8.0).contains(&gain), "vibrance", f64::from(gain), "from 1 to 8")?;
    if !pixels.len().is_multiple_of(3) {
        let expected = pixels.len().next_multiple_of(3);
        return Err(Error::Length { name: "pixels", actual: pixels.len(), expected });
    }
    if gain > 1.0 {
        pixels.chunks_mut(3 * BLOCK).for_each(|block| strengthen(block, gain));
    }
    Ok(())
}

fn strengthen(pixels: &mut [u8], gain: f32) {
    let [mut red, mut green, mut blue] = [[0.0_f32; BLOCK]; 3];
    for (at, pixel) in pixels.as_chunks::<3>().0.iter().enumerate() {
        [red[at], green[at], blue[at]] = pixel.map(f32::from);
    }
    let falls = (gain - 1.0) / STRONG;
    for ((red, green), blue) in red.iter_mut().zip(&mut green).zip(&mut blue) {
        let bright = LUMA[0] * *red + LUMA[1] * *green + LUMA[2] * *blue;
        let away = [*red - bright, *green - bright, *blue - bright];
        let colour = away[0].abs().max(away[1].abs()).max(away[2].abs());
        let factor = gain / (1.0 + falls * colour);
        // Half a level more, so that cutting off what follows the point rounds.
        [*red, *green, *blue] = away.map(|away| bright + factor * away + 0.5);
    }
    for (at, pixel) in pixels.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        *pixel = [red[at] as u8, green[at] as u8, blue[at] as u8];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn shown(pixel: [u8; 3], gain: f32) -> [u8; 3] {
        let mut pixels = pixel;
        vibrant(&mut pixels, gain).unwrap();
        pixels
    }

    #[test]
    fn a_pale_red_by_hand() {
        // y = .299 * 130 + .701 * 100 = 108.97, d = 21.03 and -8.97, factor 3 / (1 + 2 * 21.03 / 128) = 2.2580:
        // 108.97 + 47.49 = 156.46 and 108.97 - 20.25 = 88.72.
        assert_eq!(shown([130, 100, 100], 3.0), [156, 89, 89]);
    }

    #[test]
    fn a_strong_colour_is_not_driven_out_of_range() {
        // Blue: y = 29.07, d = 225.93: factor 3 / (1 + 2 * 225.93 / 128) = .6622, so 178.7, and 29.07 - 19.25 = 9.8.
        assert_eq!(shown([0, 0, 255], 3.0), [10, 10, 179]);
        // y = 117.12, d = -117.12, 32.88 and 137.88: factor .9512, so 5.72, 148.4 and 248.3.
        assert_eq!(shown([0, 150, 255], 3.0), [6, 148, 248]);
    }

    #[test]
    fn gains_and_lengths_out_of_bounds_are_refused() {
        for gain in [0.99, 8.01, f32::NAN, f32::INFINITY] {
            let refused = vibrant(&mut [1, 2, 3], gain).unwrap_err().to_string();
            assert!(refused.ends_with("it must be from 1 to 8"), "{refused}");
        }
        assert_eq!(vibrant(&mut [1, 2], 2.0).unwrap_err().to_string(), "pixels has 2 values; 3 are needed");
    }

    proptest! {
        #[test]
        fn grey_and_gain_one_change_nothing(pixels in prop::collection::vec(any::<u8>(), 0..300), gain in 1.0_f32..8.0) {
            let mut grey: Vec<u8> = pixels.iter().flat_map(|&level| [level; 3]).collect();
            let before = grey.clone();
            vibrant(&mut grey, gain).unwrap();
            prop_assert_eq!(&grey, &before);
            let mut whole = pixels[..pixels.len() / 3 * 3].to_vec();
            vibrant(&mut whole, 1.0).unwrap();
            prop_assert_eq!(&whole[..], &pixels[..whole.len()]);
        }

        /// Each pixel by itself, in double precision: brightness and order of the channels stay, the palest gain most.
        #[test]
        fn as_the_formula_says(pixels in prop::collection::vec(any::<[u8; 3]>(), 1..200), gain in 1.001_f32..8.0) {
            let mut flat: Vec<u8> = pixels.iter().flatten().copied().collect();
            vibrant(&mut flat, gain).unwrap();
            let gain = f64::from(gain);
            for (before, after) in pixels.iter().zip(flat.as_chunks::<3>().0) {
                let levels = before.map(f64::from);
                let bright = 0.299 * levels[0] + 0.587 * levels[1] + 0.114 * levels[2];
                let colour = levels.iter().map(|level| (level - bright).abs()).fold(0.0, f64::max);
                for (level, &shown) in levels.iter().zip(after) {
                    let wanted = bright + (level - bright) * gain / (1.0 + (gain - 1.0) * colour / 128.0);
                    prop_assert!((wanted.clamp(0.0, 255.0) - f64::from(shown)).abs() < 0.501, "{before:?} {after:?}");
                }
            }
        }
    }
}
