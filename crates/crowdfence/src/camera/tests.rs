use std::f64::consts::{FRAC_1_SQRT_2, PI};

use proptest::prelude::*;

use super::*;

fn camera(focal_px: f64, distortion: Distortion) -> Camera {
    Camera::new(640, 480, focal_px, focal_px, 320.0, 240.0, distortion).unwrap()
}

/// Pixels measured from the image centre, so that the numbers of the model stand for themselves.
fn centred(focal_px: f64, distortion: Distortion) -> Camera {
    Camera::new(640, 480, focal_px, focal_px, 0.0, 0.0, distortion).unwrap()
}

fn barrel(k1: f64) -> Distortion {
    Distortion::brown_conrady(&[k1, 0.0, 0.0, 0.0]).unwrap()
}

fn fisheye(k1: f64) -> Distortion {
    Distortion::kannala_brandt(&[k1, 0.0, 0.0, 0.0]).unwrap()
}

fn at_angle(theta: f64) -> DVec3 {
    DVec3::new(theta.sin(), 0.0, theta.cos())
}

#[track_caller]
fn assert_close(actual: Option<DVec2>, u: f64, v: f64) {
    let error = (actual.unwrap() - DVec2::new(u, v)).length();
    assert!(error < 1e-9, "{actual:?} is not ({u}, {v})");
}

#[test]
fn pinhole_by_hand() {
    let camera = Camera::new(640, 480, 400.0, 500.0, 320.0, 240.0, Distortion::None).unwrap();
    let point = DVec3::new(1.0, -2.0, 4.0);
    assert_close(camera.project(point), 420.0, -10.0);
    let ray = camera.unproject(DVec2::new(420.0, -10.0)).unwrap();
    assert!((ray - point / 21.0_f64.sqrt()).length() < 1e-15);
}

#[test]
fn rays_go_through_pixel_centres_row_after_row() {
    let camera = Camera::new(3, 2, 1.0, 1.0, 1.5, 1.0, Distortion::None).unwrap();
    let rays = camera.pixel_rays();
    assert_eq!(rays.len(), 6);
    assert_eq!(rays[1], Some(DVec3::new(0.0, -0.5, 1.0).normalize()));
    assert_eq!(rays[5], Some(DVec3::new(1.0, 0.5, 1.0).normalize()));
    assert_eq!(rays[5], camera.pixel_ray(2, 1));
}

#[test]
fn image_holds_its_first_edges_but_not_its_last() {
    let camera = camera(100.0, Distortion::None);
    for (u, v, inside) in [
        (0.0, 0.0, true),
        (639.999, 479.999, true),
        (640.0, 10.0, false),
        (10.0, 480.0, false),
        (-1e-12, 10.0, false),
        (f64::NAN, 10.0, false),
    ] {
        assert_eq!(camera.contains(DVec2::new(u, v)), inside, "({u}, {v})");
    }
}

#[test]
fn brown_conrady_by_hand() {
    // r^2 = 5: radial factor 1 + 0.5 + 0.25 + 0.125; tangential (0.04 + 0.14, 0.13 + 0.08).
    let distortion = Distortion::brown_conrady(&[0.1, 0.01, 0.01, 0.02, 0.001]).unwrap();
    assert_close(centred(100.0, distortion).project(DVec3::new(2.0, 4.0, 2.0)), 205.5, 396.0);
}

#[test]
fn kannala_brandt_by_hand() {
    // One radian off the axis: 1 + 0.1 + 0.02 + 0.003 + 0.0004.
    let distortion = Distortion::kannala_brandt(&[0.1, 0.02, 0.003, 0.0004]).unwrap();
    assert_close(centred(100.0, distortion).project(at_angle(1.0)), 112.34, 0.0);
}

#[test]
fn fisheye_sees_beyond_ninety_degrees() {
    let camera = centred(100.0, fisheye(0.0));
    assert_close(camera.project(DVec3::X), 50.0 * PI, 0.0);
    assert_close(camera.project(DVec3::new(0.0, 7.0, -7.0)), 0.0, 75.0 * PI);
    let ray = camera.unproject(DVec2::new(0.0, 75.0 * PI)).unwrap();
    assert!((ray - DVec3::new(0.0, FRAC_1_SQRT_2, -FRAC_1_SQRT_2)).length() < 1e-15);
}

#[test]
fn fisheye_ends_straight_behind() {
    let camera = centred(100.0, fisheye(0.0));
    assert_eq!(camera.project(DVec3::NEG_Z), None);
    assert_close(camera.project(at_angle(PI - 1e-3)), 100.0 * (PI - 1e-3), 0.0);
    assert!(camera.unproject(DVec2::new(100.0 * PI - 1e-6, 0.0)).is_ok());
    assert!(camera.unproject(DVec2::new(100.0 * PI + 1e-6, 0.0)).is_err());
}

#[test]
fn pinhole_sees_nothing_beside_or_behind() {
    for distortion in [Distortion::None, barrel(0.0), barrel(-0.2)] {
        let camera = camera(100.0, distortion);
        for point in [DVec3::X, DVec3::NEG_Z, DVec3::new(1.0, 1.0, -1.0), DVec3::ZERO] {
            assert_eq!(camera.project(point), None, "{distortion:?} {point}");
        }
    }
}

#[test]
fn barrel_distortion_does_not_wrap_into_the_image() {
    // r (1 - r^2 / 3) grows up to r = 1, where it is 2 / 3, and is back at 0 for r = sqrt 3.
    let camera = centred(300.0, barrel(-1.0 / 3.0));
    let point = |r: f64| DVec3::new(0.6 * r, 0.8 * r, 1.0);
    let edge = 0.999_f64;
    let edge_px = 300.0 * (edge - edge.powi(3) / 3.0);
    assert_close(camera.project(point(edge)), 0.6 * edge_px, 0.8 * edge_px);
    for beyond in [1.0 + 1e-9, 1.5, 1.7, 3.0_f64.sqrt(), 2.0, 1e3, 1e200] {
        assert_eq!(camera.project(point(beyond)), None, "r = {beyond}");
    }
}

#[test]
fn fisheye_does_not_wrap_into_the_image() {
    let camera = centred(300.0, fisheye(-1.0 / 3.0));
    assert!(camera.project(at_angle(1.0 - 1e-9)).is_some());
    for beyond in [1.0 + 1e-9, 1.5, 1.7, 2.5, 3.1] {
        assert_eq!(camera.project(at_angle(beyond)), None, "theta = {beyond}");
    }
}

#[test]
fn pixel_beyond_the_fold_has_no_ray() {
    for distortion in [barrel(-1.0 / 3.0), fisheye(-1.0 / 3.0)] {
        let camera = centred(300.0, distortion);
        assert!(camera.unproject(DVec2::new(120.0, -160.0 + 1e-6)).is_ok());
        let (u, v) = (120.0, -160.0 - 1e-6);
        assert_eq!(camera.unproject(DVec2::new(u, v)), Err(CameraError::NotInvertible { u, v }));
        assert!(camera.unproject(DVec2::new(1e6, 0.0)).is_err());
    }
}

#[test]
fn second_branch_of_the_polynomial_is_not_used() {
    // Slope 1 - 5 r^2 + 4 r^4 = (1 - r^2) (1 - 4 r^2): turns back at 1 / 2, forth again at 1.
    let distortion = Distortion::brown_conrady(&[-5.0 / 3.0, 4.0 / 5.0, 0.0, 0.0]).unwrap();
    let camera = centred(1000.0, distortion);
    assert!(camera.project(DVec3::new(0.4999, 0.0, 1.0)).is_some());
    assert_eq!(camera.project(DVec3::new(0.5001, 0.0, 1.0)), None);
    // 1.1 would be imaged at 1.1 (1 - 2.01667 + 1.17128) = 0.17008, which belongs to a direction nearer the
    // axis.
    assert_eq!(camera.project(DVec3::new(1.1, 0.0, 1.0)), None);
    let ray = camera.unproject(DVec2::new(170.08, 0.0)).unwrap();
    assert!(ray.x / ray.z < 0.5, "{ray}");
}

#[test]
fn blind_pixels_of_a_strong_barrel_lens_lie_outside_a_circle() {
    // The fold is imaged at 2 / 3 of 150 pixels.
    for distortion in [barrel(-1.0 / 3.0), fisheye(-1.0 / 3.0)] {
        let camera = Camera::new(240, 220, 150.0, 150.0, 120.0, 110.0, distortion).unwrap();
        let outside = |i: i64, j: i64| (2 * i + 1 - 240).pow(2) + (2 * j + 1 - 220).pow(2) > 200 * 200;
        let expected: Vec<bool> = (0..220).flat_map(|j| (0..240).map(move |i| outside(i, j))).collect();
        let blind: Vec<bool> = camera.pixel_rays().iter().map(Option::is_none).collect();
        assert!(blind == expected);
        assert_eq!(camera.blind_pixel_count(), expected.iter().filter(|&&blind| blind).count());
    }
    assert_eq!(camera(300.0, Distortion::None).blind_pixel_count(), 0);
}

#[test]
fn axis_and_extreme_lengths() {
    for distortion in [Distortion::None, barrel(-0.2), fisheye(-0.1)] {
        let camera = camera(300.0, distortion);
        assert_eq!(camera.unproject(DVec2::new(320.0, 240.0)), Ok(DVec3::Z));
        let expected = camera.project(DVec3::new(0.5, 0.25, 1.0)).unwrap();
        for length in [5e-324_f64, 1e-310, 1e-160, 1.0, 1e160, 1e308] {
            assert_eq!(camera.project(DVec3::Z * length), Some(DVec2::new(320.0, 240.0)), "{length}");
            if length > 1e-300 {
                let pixel = camera.project(DVec3::new(0.5, 0.25, 1.0) * length);
                assert_close(pixel, expected.x, expected.y);
            }
            let beside = camera.project(DVec3::new(length.min(1e-20), 0.0, 1.0));
            assert_close(beside, 320.0, 240.0);
        }
        for broken in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            for point in [DVec3::new(broken, 0.0, 1.0), DVec3::new(0.0, 1.0, broken), DVec3::splat(broken)] {
                // Infinitely far ahead is no point either, although 1 / inf would be the image centre.
                assert_eq!(camera.project(point), None, "{distortion:?} {point}");
            }
        }
    }
}

#[test]
fn far_pixels_are_rays_or_errors() {
    for distortion in [Distortion::None, barrel(0.1), barrel(-0.1), fisheye(0.1), fisheye(-0.1)] {
        let camera = camera(300.0, distortion);
        for far in [1e6, 1e100, 1e200, f64::MAX] {
            if let Ok(ray) = camera.unproject(DVec2::new(far, -far)) {
                assert!((ray.length() - 1.0).abs() < 1e-12, "{distortion:?} {far} {ray}");
            }
        }
    }
}

#[test]
fn refusals_name_the_value() {
    let make = |width, height, fx, cy, distortion| Camera::new(width, height, fx, 1.0, 0.0, cy, distortion);
    let message = |made: Result<Camera, CameraError>| made.unwrap_err().to_string();
    let none = Distortion::None;
    assert!(message(make(0, 480, 1.0, 0.0, none)).contains("0 x 480"));
    assert!(message(make(65_536, 1, 1.0, 0.0, none)).contains("65536 x 1"));
    assert!(message(make(60_000, 60_000, 1.0, 0.0, none)).contains("268435456 in all"));
    let impossible = [
        (0.0, "0"),
        (-0.0, "-0"),
        (-500.0, "-500"),
        (f64::NAN, "NaN"),
        (f64::INFINITY, "inf"),
        (1e-300, "1e-300"),
    ];
    for (fx, shown) in impossible {
        let error = message(make(640, 480, fx, 0.0, none));
        assert!(error.contains(&format!("fx is {shown} pixels")), "{error}");
    }
    assert!(message(make(640, 480, 1.0, f64::NAN, none)).contains("cy is NaN"));
    let nan = Distortion::kannala_brandt(&[0.0, 0.0, f64::NAN, 0.0]).unwrap();
    assert!(message(make(640, 480, 1.0, 0.0, nan)).contains("k3 is NaN"));
    assert!(message(make(640, 480, 1.0, 0.0, barrel(f64::INFINITY))).contains("k1 is inf"));
    let pixel = camera(1.0, none).unproject(DVec2::new(f64::NAN, 2.0)).unwrap_err();
    assert_eq!(pixel.to_string(), "pixel (NaN, 2) is not finite");
}

/// Coefficients far beyond those of real lenses, so that many have a fold inside the image.
fn any_brown_conrady() -> impl Strategy<Value = Distortion> {
    let (radial, tangential) = (-0.6..0.6_f64, -0.05..0.05_f64);
    (radial.clone(), radial.clone(), tangential.clone(), tangential, radial)
        .prop_map(|(k1, k2, p1, p2, k3)| Distortion::BrownConrady { k1, k2, p1, p2, k3 })
}

fn any_kannala_brandt() -> impl Strategy<Value = Distortion> {
    (-0.3..0.3_f64, -0.1..0.1_f64, -0.03..0.03_f64, -0.01..0.01_f64)
        .prop_map(|(k1, k2, k3, k4)| Distortion::KannalaBrandt { k1, k2, k3, k4 })
}

fn any_distortion() -> impl Strategy<Value = Distortion> {
    prop_oneof![Just(Distortion::None), any_brown_conrady(), any_kannala_brandt()]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4096))]

    #[test]
    fn ray_of_a_pixel_projects_to_the_pixel(
        distortion in any_distortion(),
        u in -50.0..690.0_f64,
        v in -50.0..530.0_f64,
        focal_px in 150.0..2000.0_f64,
    ) {
        let camera = camera(focal_px, distortion);
        let pixel = DVec2::new(u, v);
        if let Ok(ray) = camera.unproject(pixel) {
            prop_assert!((ray.length() - 1.0).abs() < 1e-15);
            let error_px = (camera.project(ray).unwrap() - pixel).length();
            prop_assert!(error_px < 1e-9, "{error_px} px");
        }
    }

    /// No direction shares its pixel with another: whatever is seen comes back as itself.
    #[test]
    fn seen_direction_is_the_ray_of_its_pixel(
        distortion in any_distortion(), theta in 0.0..PI, azimuth in 0.0..6.3_f64, range_m in 0.01..1e4_f64,
    ) {
        let camera = camera(500.0, distortion);
        let direction = DVec3::new(theta.sin() * azimuth.cos(), theta.sin() * azimuth.sin(), theta.cos());
        if let Some(pixel) = camera.project(direction * range_m) {
            let ray = camera.unproject(pixel).unwrap();
            // Beside the fold, where the image stands still, half of the digits are all there is.
            prop_assert!((ray - direction).length() < 1e-6, "{ray} {direction}");
        }
    }

    /// A small triangle in front of the camera keeps its orientation in the image wherever it is seen.
    #[test]
    fn image_is_never_mirrored(distortion in any_brown_conrady(), x in -3.0..3.0_f64, y in -3.0..3.0_f64) {
        let camera = centred(1.0, distortion);
        let step = 1e-5;
        let corner = |dx: f64, dy: f64| camera.project(DVec3::new(x + dx, y + dy, 1.0));
        if let (Some(a), Some(b), Some(c)) = (corner(0.0, 0.0), corner(step, 0.0), corner(0.0, step)) {
            prop_assert!((b - a).perp_dot(c - a) > -1e-14 * step, "{a} {b} {c}");
        }
    }

    /// The field of view ends where a march along the radius first sees the image stand still.
    #[test]
    fn field_of_view_ends_at_the_first_fold(
        k1 in -0.6..0.6_f64, k2 in -0.6..0.6_f64, k3 in -0.6..0.6_f64, azimuth in 0.0..6.3_f64,
    ) {
        let camera = centred(1.0, Distortion::BrownConrady { k1, k2, p1: 0.0, p2: 0.0, k3 });
        let image = |r: f64| r + k1 * r.powi(3) + k2 * r.powi(5) + k3 * r.powi(7);
        let seen = |r: f64| camera.project(DVec3::new(r * azimuth.cos(), r * azimuth.sin(), 1.0)).is_some();
        let step = 1e-3;
        let grows = |i: i32| image(step * f64::from(i + 1)) > image(step * f64::from(i));
        let fold = (0..4000).find(|&i| !grows(i)).map(|i| step * f64::from(i));
        match fold {
            Some(fold) => prop_assert!(seen(fold - 2.0 * step) && !seen(fold + 2.0 * step), "fold at {fold}"),
            None => prop_assert!(seen(3.9)),
        }
    }
}
