//! Pinhole camera -> where in the image a point of the grid lies, before the division by its depth.

use glam::{DVec2, DVec3};

use super::canvas::{MAX_CORNERS, Polygon, highest, lowest};
use crate::camera::IdealPixels;
use crate::view::View;

/// Nearest depth at which a point still has a place in the image, in voxels.
pub const NEAR: f64 = 1e-6;

/// A point of the image times its depth.
#[derive(Debug, Clone, Copy)]
pub struct Imaged {
    pub u: f64,
    pub v: f64,
    pub depth: f64,
}

impl Imaged {
    #[inline(always)]
    pub fn pixel(self) -> DVec2 {
        DVec2::new(self.u, self.v) / self.depth
    }

    fn mix(self, other: Imaged, share: f64) -> Imaged {
        let mix = |a: f64, b: f64| a + (b - a) * share;
        Imaged { u: mix(self.u, other.u), v: mix(self.v, other.v), depth: mix(self.depth, other.depth) }
    }
}

/// Image of points that are given relative to the camera in the directions of the world.
#[derive(Debug, Clone)]
pub struct Optics {
    pub u: DVec3,
    pub v: DVec3,
    pub depth: DVec3,
    /// Between these pixel coordinates lies the image.
    pub low: DVec2,
    pub high: DVec2,
    /// Pixels per radian at the centre, the smaller of the two.
    pub focal_px: f64,
    world_from_camera: glam::DMat3,
    focal: DVec2,
    principal: DVec2,
}

impl Optics {
    /// Of a view through a pinhole, or of one through a lens as a pinhole would see it.
    pub fn of(view: &View, lens: Option<&IdealPixels>) -> Optics {
        let camera = &view.camera;
        let size = DVec2::new(f64::from(camera.width()), f64::from(camera.height()));
        let (low, high) = lens.map_or((DVec2::ZERO, size), IdealPixels::bounds);
        let axes = view.world_from_camera.rotation;
        Optics {
            u: axes.x_axis * camera.fx() + axes.z_axis * camera.cx(),
            v: axes.y_axis * camera.fy() + axes.z_axis * camera.cy(),
            depth: axes.z_axis,
            low,
            high,
            focal_px: camera.fx().min(camera.fy()),
            world_from_camera: axes,
            focal: DVec2::new(camera.fx(), camera.fy()),
            principal: DVec2::new(camera.cx(), camera.cy()),
        }
    }

    #[inline(always)]
    pub fn image(&self, point: DVec3) -> Imaged {
        Imaged { u: self.u.dot(point), v: self.v.dot(point), depth: self.depth.dot(point) }
    }

    /// Image of the corners of a polygon, with their least depth.
    #[inline(always)]
    pub fn polygon(&self, corners: &[DVec3; MAX_CORNERS]) -> (Polygon, f64) {
        let x = corners.map(|corner| corner.x);
        let y = corners.map(|corner| corner.y);
        let z = corners.map(|corner| corner.z);
        let mut polygon = Polygon { x: [0.0; MAX_CORNERS], y: [0.0; MAX_CORNERS] };
        let mut depth = [0.0; MAX_CORNERS];
        for at in 0..MAX_CORNERS {
            let image = |axis: DVec3| axis.x * x[at] + axis.y * y[at] + axis.z * z[at];
            depth[at] = image(self.depth);
            let inverse = 1.0 / depth[at];
            polygon.x[at] = image(self.u) * inverse;
            polygon.y[at] = image(self.v) * inverse;
        }
        (polygon, lowest(&depth))
    }

    /// Direction of the ray through a place of the image, of any length.
    pub fn ray(&self, pixel: DVec2) -> DVec3 {
        self.world_from_camera * ((pixel - self.principal) / self.focal).extend(1.0)
    }

    /// The rectangle of the image around a box; None when a part of it is beside or behind the camera.
    pub fn around(&self, low: DVec3, high: DVec3) -> Option<(DVec2, DVec2)> {
        let corners = std::array::from_fn(|number| {
            let is_high = |axis: usize| number >> axis & 1 != 0;
            DVec3::from_array(std::array::from_fn(|axis| if is_high(axis) { high[axis] } else { low[axis] }))
        });
        let (polygon, depth) = self.polygon(&corners);
        let low = DVec2::new(lowest(&polygon.x), lowest(&polygon.y));
        let high = DVec2::new(highest(&polygon.x), highest(&polygon.y));
        (depth > NEAR).then_some((low, high))
    }

    /// Whether a box may have a part in the image: false when all of its corners lie beyond one side of it, or
    /// behind the camera.
    pub fn may_show(&self, low: DVec3, high: DVec3) -> bool {
        // Per bound, the corner that is furthest inside.
        let inside = |normal: DVec3| {
            let furthest = DVec3::select(normal.cmpgt(DVec3::ZERO), high, low);
            normal.dot(furthest) > 0.0
        };
        inside(self.depth)
            && inside(self.u - self.depth * self.low.x)
            && inside(self.v - self.depth * self.low.y)
            && inside(self.depth * self.high.x - self.u)
            && inside(self.depth * self.high.y - self.v)
    }
}

/// The part of a polygon before the camera, which may be nothing.
#[inline(always)]
pub fn before_camera(corners: &[Imaged]) -> Option<Polygon> {
    let mut polygon = Polygon { x: [0.0; MAX_CORNERS], y: [0.0; MAX_CORNERS] };
    let mut count = 0;
    let mut keep = |point: Imaged| {
        polygon.x[count] = point.u / point.depth;
        polygon.y[count] = point.v / point.depth;
        count += 1;
    };
    for (at, &to) in corners.iter().enumerate() {
        let from = corners[(at + corners.len() - 1) % corners.len()];
        if (from.depth < NEAR) != (to.depth < NEAR) {
            let share = (NEAR - from.depth) / (to.depth - from.depth);
            keep(Imaged { depth: NEAR, ..from.mix(to, share) });
        }
        if to.depth >= NEAR {
            keep(to);
        }
    }
    let last = count.checked_sub(1)?;
    for spare in count..MAX_CORNERS {
        polygon.x[spare] = polygon.x[last];
        polygon.y[spare] = polygon.y[last];
    }
    Some(polygon)
}
