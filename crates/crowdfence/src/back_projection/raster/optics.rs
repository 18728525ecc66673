//! Pinhole camera -> where in the image a point of the grid lies, before the division by its depth.

use glam::{DVec2, DVec3};

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
    u: DVec3,
    v: DVec3,
    depth: DVec3,
    pub size: DVec2,
    /// Pixels per radian at the centre, the smaller of the two.
    pub focal_px: f64,
    world_from_camera: glam::DMat3,
    focal: DVec2,
    principal: DVec2,
}

impl Optics {
    /// Of a view through a pinhole; the lens is not looked at.
    pub fn of(view: &View) -> Optics {
        let camera = &view.camera;
        let axes = view.world_from_camera.rotation;
        Optics {
            u: axes.x_axis * camera.fx() + axes.z_axis * camera.cx(),
            v: axes.y_axis * camera.fy() + axes.z_axis * camera.cy(),
            depth: axes.z_axis,
            size: DVec2::new(f64::from(camera.width()), f64::from(camera.height())),
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

    /// Direction of the ray through the centre of a pixel, of any length.
    pub fn ray(&self, column: usize, row: usize) -> DVec3 {
        let pixel = DVec2::new(column as f64, row as f64) + 0.5;
        self.world_from_camera * ((pixel - self.principal) / self.focal).extend(1.0)
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
            && inside(self.u)
            && inside(self.v)
            && inside(self.depth * self.size.x - self.u)
            && inside(self.depth * self.size.y - self.v)
    }
}

/// The part of a polygon before the camera, as continuous pixel coordinates in `corners`; how many there are.
#[inline(always)]
pub fn before_camera(polygon: &[Imaged], corners: &mut [DVec2]) -> usize {
    let mut count = 0;
    let mut keep = |point: Imaged| {
        corners[count] = point.pixel();
        count += 1;
    };
    for (at, &to) in polygon.iter().enumerate() {
        let from = polygon[(at + polygon.len() - 1) % polygon.len()];
        if (from.depth < NEAR) != (to.depth < NEAR) {
            let share = (NEAR - from.depth) / (to.depth - from.depth);
            keep(Imaged { depth: NEAR, ..from.mix(to, share) });
        }
        if to.depth >= NEAR {
            keep(to);
        }
    }
    count
}
