//! What one drone saw at one instant: heatmap, camera, pose and stamp.

use std::borrow::Cow;
use std::sync::Arc;

use glam::{DMat3, DVec3};

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::stamp::check_stamp;

/// Largest deviation of R^T R from the identity, of det R from 1 and of the last row from (0, 0, 0, 1).
/// Quaternions written with four decimals pass, a scaled or sheared matrix does not.
const RIGID_TOLERANCE: f64 = 1e-4;

/// What one drone saw at one instant.
#[derive(Debug, Clone)]
pub struct View {
    pub(crate) drone: String,
    pub(crate) stamp_ns: i64,
    pub(crate) camera: Arc<Camera>,
    pub(crate) world_from_camera: Pose,
    pub(crate) heatmap: Heatmap,
}

impl View {
    /// Errors: a drone without a name, a negative stamp, a heatmap that is no reduction of the camera's image by one
    /// stride ([`Error::HeatmapShape`]).
    pub fn new(
        drone: impl Into<String>,
        stamp_ns: i64,
        camera: Arc<Camera>,
        world_from_camera: Pose,
        heatmap: Heatmap,
    ) -> Result<View> {
        let drone = drone.into();
        if drone.is_empty() {
            return Err(Error::UnnamedDrone);
        }
        check_stamp(stamp_ns)?;
        heatmap.check_covers(&camera)?;
        Ok(View { drone, stamp_ns, camera, world_from_camera, heatmap })
    }

    /// Name of the drone, not empty.
    pub fn drone(&self) -> &str {
        &self.drone
    }

    /// When the picture was taken, nanoseconds since the Unix epoch.
    pub fn stamp_ns(&self) -> i64 {
        self.stamp_ns
    }

    /// The camera; views that share one share what it works out once.
    pub fn camera(&self) -> &Arc<Camera> {
        &self.camera
    }

    /// Where the camera was and looked.
    pub fn world_from_camera(&self) -> Pose {
        self.world_from_camera
    }

    /// What the detector says of the picture.
    pub fn heatmap(&self) -> &Heatmap {
        &self.heatmap
    }

    /// Heatmap value read by the pixel in `column` and `row` of the image.
    pub fn value_at(&self, column: u32, row: u32) -> f32 {
        let row = cell(row, self.heatmap.height, self.camera.height());
        let column = cell(column, self.heatmap.width, self.camera.width());
        self.heatmap.values[row * self.heatmap.width + column]
    }

    /// The same for every pixel, row after row.
    pub fn pixel_values(&self) -> Cow<'_, [f32]> {
        self.at_pixels(&self.heatmap.values)
    }

    /// Whether the heatmap says anything of the pixel in `column` and `row` of the image.
    pub fn is_looked_at(&self, column: u32, row: u32) -> bool {
        self.heatmap.looked_at.as_ref().is_none_or(|looked_at| {
            let row = cell(row, self.heatmap.height, self.camera.height());
            looked_at[row * self.heatmap.width + cell(column, self.heatmap.width, self.camera.width())]
        })
    }

    /// The same for every pixel, row after row; None where it does of all.
    pub fn looked_at_pixels(&self) -> Option<Cow<'_, [bool]>> {
        self.heatmap.looked_at.as_deref().map(|looked_at| self.at_pixels(looked_at))
    }

    /// What the cells of the heatmap hold for every pixel, row after row.
    fn at_pixels<'a, T: Copy>(&self, cells: &'a [T]) -> Cow<'a, [T]> {
        let (width, height) = (self.camera.width(), self.camera.height());
        if self.heatmap.shape() == [height as usize, width as usize] {
            return Cow::Borrowed(cells);
        }
        let columns: Vec<usize> = (0..width).map(|column| cell(column, self.heatmap.width, width)).collect();
        let mut values: Vec<T> = Vec::with_capacity(width as usize * height as usize);
        let mut last = None;
        for row in (0..height).map(|row| cell(row, self.heatmap.height, height)) {
            if last == Some(row) {
                values.extend_from_within(values.len() - width as usize..);
            } else {
                let cells = &cells[row * self.heatmap.width..][..self.heatmap.width];
                values.extend(columns.iter().map(|&column| cells[column]));
            }
            last = Some(row);
        }
        Cow::Owned(values)
    }
}

/// Heatmap cell that a pixel reads. A cell covers pixels / cells pixels; the pixel reads the one that holds its
/// centre, which in integers is (2 i + 1) cells / (2 pixels).
fn cell(pixel: u32, cells: usize, pixels: u32) -> usize {
    (2 * pixel as usize + 1) * cells / (2 * pixels as usize)
}

/// Rigid transform from camera axes (x right, y down, z forward) to the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    pub(crate) rotation: DMat3,
    pub(crate) translation: DVec3,
}

impl Pose {
    /// From a row-major 4 x 4 matrix [R t; 0 0 0 1].
    pub fn from_matrix(rows: &[[f64; 4]; 4]) -> Result<Pose> {
        for (row, values) in rows.iter().enumerate() {
            for (column, &value) in values.iter().enumerate() {
                if !value.is_finite() {
                    return Err(Error::PoseNotFinite { row, column, value });
                }
            }
        }
        let rotation = DMat3::from_cols_array_2d(&std::array::from_fn(|column| {
            std::array::from_fn(|row| rows[row][column])
        }));
        let not_identity = rotation.transpose() * rotation - DMat3::IDENTITY;
        let last_row = [rows[3][0], rows[3][1], rows[3][2], rows[3][3] - 1.0];
        let largest = |values: &[f64]| values.iter().fold(0.0f64, |max, v| max.max(v.abs()));
        for (what, error) in [
            ("the last row", largest(&last_row)),
            ("R^T R", largest(&not_identity.to_cols_array())),
            ("det R", (rotation.determinant() - 1.0).abs()),
        ] {
            if error > RIGID_TOLERANCE {
                return Err(Error::PoseNotRigid { what, error, bound: RIGID_TOLERANCE });
            }
        }
        Ok(Pose { rotation, translation: DVec3::new(rows[0][3], rows[1][3], rows[2][3]) })
    }

    /// The same from its parts.
    pub fn new(rotation: DMat3, translation: DVec3) -> Result<Pose> {
        Pose::from_matrix(&Pose { rotation, translation }.to_matrix())
    }

    /// Turns camera axes into those of the world.
    pub fn rotation(&self) -> DMat3 {
        self.rotation
    }

    /// Position of the camera, world metres.
    pub fn translation(&self) -> DVec3 {
        self.translation
    }

    /// Row-major [R t; 0 0 0 1], the inverse of [`Pose::from_matrix`].
    pub fn to_matrix(&self) -> [[f64; 4]; 4] {
        let mut rows = [[0.0, 0.0, 0.0, 1.0]; 4];
        for (row, values) in rows.iter_mut().take(3).enumerate() {
            let r = self.rotation.row(row);
            *values = [r.x, r.y, r.z, self.translation[row]];
        }
        rows
    }
}

/// Detector output in [0, 1], row-major, at any stride of the image.
#[derive(Debug, Clone, PartialEq)]
pub struct Heatmap {
    /// 0 in cells that were not looked at.
    values: Vec<f32>,
    height: usize,
    width: usize,
    /// False in cells that the detector was not shown; None: it was shown all.
    looked_at: Option<Vec<bool>>,
}

impl Heatmap {
    /// `values` row after row, each in [0, 1].
    ///
    /// Errors: no cell, a length that is not `height` times `width`, a value outside or NaN, by its row and column.
    pub fn new(values: Vec<f32>, height: usize, width: usize) -> Result<Heatmap> {
        if height == 0 || width == 0 {
            return Err(Error::EmptyHeatmap { height, width });
        }
        let expected = height.saturating_mul(width);
        if values.len() != expected {
            return Err(Error::Length { name: "heatmap", actual: values.len(), expected });
        }
        if let Some(at) = values.iter().position(|value| !(0.0..=1.0).contains(value)) {
            return Err(Error::HeatmapValue { row: at / width, column: at % width, value: values[at] });
        }
        Ok(Heatmap { values, height, width, looked_at: None })
    }

    /// The same of a detector that was not shown the whole picture: cells where `looked_at` is false say nothing, neither
    /// crowd nor empty, whatever value they hold.
    pub fn of_part(mut self, looked_at: Vec<bool>) -> Result<Heatmap> {
        if looked_at.len() != self.values.len() {
            let (actual, expected) = (looked_at.len(), self.values.len());
            return Err(Error::Length { name: "looked_at", actual, expected });
        }
        let cells = self.values.iter_mut().zip(&looked_at);
        cells.filter(|&(_, &looked_at)| !looked_at).for_each(|(value, _)| *value = 0.0);
        self.looked_at = looked_at.contains(&false).then_some(looked_at);
        Ok(self)
    }

    /// 8-bit heatmap: value / 255.
    pub fn from_u8(values: &[u8], height: usize, width: usize) -> Result<Heatmap> {
        let values = values.iter().map(|&value| f32::from(value) / 255.0).collect();
        Heatmap::new(values, height, width)
    }

    /// Row after row; 0 in cells that were not looked at.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Which cells the detector was shown; None: all.
    pub fn looked_at(&self) -> Option<&[bool]> {
        self.looked_at.as_deref()
    }

    /// Rows and columns.
    pub fn shape(&self) -> [usize; 2] {
        [self.height, self.width]
    }

    /// A heatmap belongs to an image when one stride s, the same for rows and columns, explains both sides:
    /// side = floor(pixels / s) or ceil(pixels / s). This catches swapped axes and squashed images.
    fn check_covers(&self, camera: &Camera) -> Result<()> {
        let strides = |pixels: u32, cells: usize| {
            let (pixels, cells) = (f64::from(pixels), cells as f64);
            (pixels / (cells + 1.0), pixels / (cells - 1.0)) // open interval; one cell has no upper bound
        };
        let (low_y, high_y) = strides(camera.height(), self.height);
        let (low_x, high_x) = strides(camera.width(), self.width);
        let not_larger = self.height <= camera.height() as usize && self.width <= camera.width() as usize;
        if not_larger && low_x.max(low_y) < high_x.min(high_y) {
            return Ok(());
        }
        Err(Error::HeatmapShape {
            height: self.height,
            width: self.width,
            image_height: camera.height(),
            image_width: camera.width(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Distortion;

    #[test]
    fn a_heatmap_whose_cells_nobody_can_count_is_refused() {
        let side = 1 << (usize::BITS / 2); // times itself it wraps to 0
        assert!(Heatmap::new(vec![], side, side).is_err());
    }

    fn view(width: u32, height: u32, heatmap: [usize; 2]) -> Result<View> {
        let camera = Camera::new(width, height, 100.0, 100.0, 1.0, 1.0, Distortion::None).unwrap();
        let values = (0..heatmap[0] * heatmap[1]).map(|i| i as f32 / 1e6).collect();
        View::new(
            "uav1",
            0,
            Arc::new(camera),
            Pose::from_matrix(&IDENTITY).unwrap(),
            Heatmap::new(values, heatmap[0], heatmap[1])?,
        )
    }

    const IDENTITY: [[f64; 4]; 4] =
        [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

    #[test]
    fn every_stride_is_accepted_and_swapped_axes_are_not() {
        for heatmap in [[480, 640], [120, 160], [15, 20], [1, 1], [48, 64]] {
            view(640, 480, heatmap).unwrap();
        }
        view(1920, 1080, [34, 60]).unwrap(); // stride 32 rounded up
        for heatmap in [[160, 120], [128, 128], [480, 641]] {
            let message = view(640, 480, heatmap).unwrap_err().to_string();
            assert!(message.contains("image of 480 x 640"), "{message}");
        }
    }

    #[test]
    fn a_pixel_reads_the_cell_under_its_centre() {
        let view = view(6, 4, [2, 3]).unwrap(); // stride 2
        assert_eq!(view.value_at(0, 0), 0.0);
        assert_eq!(view.value_at(1, 1), 0.0);
        assert_eq!(view.value_at(2, 1), 1e-6);
        assert_eq!(view.value_at(5, 3), 5e-6);
    }

    #[test]
    fn the_values_of_all_pixels_are_those_of_each() {
        for (width, height, heatmap) in
            [(6, 4, [2, 3]), (640, 360, [12, 20]), (19, 7, [3, 8]), (6, 4, [4, 6])]
        {
            let view = view(width, height, heatmap).unwrap();
            let each = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
            let each: Vec<f32> = each.map(|(column, row)| view.value_at(column, row)).collect();
            assert_eq!(view.pixel_values().as_ref(), each, "{width} x {height} from {heatmap:?}");
        }
    }

    #[test]
    fn values_outside_zero_to_one_are_named_with_their_cell() {
        for value in [-0.01, 1.01, f32::NAN, f32::INFINITY] {
            let mut values = vec![0.0; 6];
            values[4] = value;
            let message = Heatmap::new(values, 2, 3).unwrap_err().to_string();
            assert!(message.contains("row 1, column 1"), "{message}");
        }
        assert!(Heatmap::new(vec![], 0, 3).unwrap_err().to_string().contains("empty"));
        assert_eq!(Heatmap::from_u8(&[0, 255, 51], 1, 3).unwrap().values(), [0.0, 1.0, 0.2]);
    }

    #[test]
    fn a_cell_that_was_not_looked_at_says_nothing_whatever_it_holds() {
        let looked_at = vec![true, false, true, true, true, false];
        let all = Heatmap::new(vec![0.1, 1.0, 0.3, 0.4, 0.5, 0.9], 2, 3).unwrap();
        let heatmap = all.clone().of_part(looked_at.clone()).unwrap();
        assert_eq!(heatmap.values(), [0.1, 0.0, 0.3, 0.4, 0.5, 0.0]);
        assert_eq!(heatmap.looked_at(), Some(looked_at.as_slice()));
        let view = View { heatmap, ..view(6, 4, [2, 3]).unwrap() };
        let each = (0..4).flat_map(|row| (0..6).map(move |column| (column, row)));
        let each: Vec<bool> = each.map(|(column, row)| view.is_looked_at(column, row)).collect();
        assert_eq!(view.looked_at_pixels().unwrap().as_ref(), each);
        assert_eq!(each.iter().filter(|&&looked_at| !looked_at).count(), 8, "two cells of four pixels");
        assert!(!view.is_looked_at(3, 1) && view.is_looked_at(3, 2) && !view.is_looked_at(4, 2));

        assert_eq!(all.clone().of_part(vec![true; 6]).unwrap(), all);
        let message = all.of_part(looked_at[1..].to_vec()).unwrap_err().to_string();
        assert!(message.contains("looked_at"), "{message}");
    }

    #[test]
    fn only_rigid_finite_poses_pass() {
        let mut scaled = IDENTITY;
        scaled[1][1] = 1.001;
        let mut mirrored = IDENTITY;
        mirrored[2][2] = -1.0;
        let mut projective = IDENTITY;
        projective[3][0] = 0.1;
        let mut nan = IDENTITY;
        nan[0][3] = f64::NAN;
        for (matrix, words) in [
            (scaled, "R^T R is off"),
            (mirrored, "det R is off"),
            (projective, "the last row is off"),
            (nan, "NaN at row 0, column 3"),
        ] {
            let message = Pose::from_matrix(&matrix).unwrap_err().to_string();
            assert!(message.contains(words), "{message}");
        }
        let pose = Pose::from_matrix(&IDENTITY).unwrap();
        assert_eq!(pose.to_matrix(), IDENTITY);

        let rotation = DMat3::from_rotation_z(0.3);
        let pose = Pose::new(rotation, DVec3::new(1.0, 2.0, 3.0)).unwrap();
        assert_eq!((pose.rotation(), pose.translation()), (rotation, DVec3::new(1.0, 2.0, 3.0)));
        let message = Pose::new(-rotation, DVec3::ZERO).unwrap_err().to_string();
        assert!(message.contains("det R is off"), "{message}");
        let message = Pose::new(rotation, DVec3::new(0.0, f64::INFINITY, 0.0)).unwrap_err().to_string();
        assert!(message.contains("inf at row 1, column 3"), "{message}");
    }
}
