use std::borrow::Cow;
use std::sync::Arc;

use crowdfence::terrain::Surface;
use crowdfence::{Coverage, Observation, Projection, SeenVoxels};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arrays::{Array, id_array, refuse};
use crate::crowd_mass::PyCrowdMass;
use crate::errors::CrowdfenceError;
use crate::released::released;
use crate::stamps::stamp_ns;
use crate::terrain::{PyTerrain, checked_ids};
use crate::view::PyView;

/// What one view says about the terrain: arrays of equal length V, one row per voxel that it sees.
///
/// terrain       the terrain that the ids are meant for
/// drone         name of the drone
/// stamp_ns      when the image was exposed: int, nanoseconds since the Unix epoch
/// voxel_ids     [V] sorted and unique
/// mean          [V] m_i of equation 1, in [0, 1]
/// pixel_count   [V] pixels that show the voxel; 0 = in view, but between the pixel centres
/// range_m       [V] from the camera to the voxel's centre, metres
/// tilt_deg      [V] of that line, degrees below the horizon: 90 is straight down; negative
///               where it comes from below, also from below the plane of the voxel's top
/// occluded_ids  [O] sorted, unique and not seen: in the image and in range, but hidden by something
/// crowd_mass    where the crowd in the picture went; None: it shows none, or nobody knows
/// focal_px      focal length of the camera in pixels, >= 0: a voxel is seen with range / focal metres per
///               pixel; 0: nobody said
///
/// `project` makes one from a view. It is checked when it is made, and cannot change: CrowdfenceError
/// names what is not sorted, not unique, not finite, out of bounds or of another length; ViewError a
/// drone without a name; StampError a stamp that is none. It can be compared, pickled, and sent as
/// bytes.
#[pyclass(frozen, name = "Observation", module = "crowdfence", eq)]
#[derive(Clone, PartialEq)]
pub struct PyObservation(pub Arc<Observation>);

#[pymethods]
impl PyObservation {
    #[new]
    #[pyo3(signature = (terrain, drone, stamp_ns, *, voxel_ids, mean, pixel_count, range_m, tilt_deg, occluded_ids,
                        crowd_mass=None, focal_px=0.0))]
    #[allow(clippy::too_many_arguments)] // the columns, keyword-only in Python
    fn new(
        terrain: &PyTerrain,
        drone: String,
        #[pyo3(from_py_with = stamp_ns)] stamp_ns: i64,
        voxel_ids: &Bound<'_, PyAny>,
        mean: &Bound<'_, PyAny>,
        pixel_count: &Bound<'_, PyAny>,
        range_m: &Bound<'_, PyAny>,
        tilt_deg: &Bound<'_, PyAny>,
        occluded_ids: &Bound<'_, PyAny>,
        crowd_mass: Option<PyRef<'_, PyCrowdMass>>,
        focal_px: f32,
    ) -> PyResult<Self> {
        let terrain = &terrain.terrain;
        let seen = SeenVoxels {
            ids: checked_ids(terrain, voxel_ids)?,
            mean: Array::<f64>::new(mean, "mean", &[None])?.to_vec()?,
            pixel_count: counts(pixel_count)?,
            range_m: Array::<f32>::new(range_m, "range_m", &[None])?.to_vec()?,
            tilt_deg: Array::<f32>::new(tilt_deg, "tilt_deg", &[None])?.to_vec()?,
        };
        let occluded_ids = checked_ids(terrain, occluded_ids)?;
        let crowd_mass = crowd_mass.map(|mass| mass.0).unwrap_or_default();
        Observation::new(terrain.key(), drone, stamp_ns, seen, occluded_ids, crowd_mass)
            .and_then(|observation| observation.with_focal_px(focal_px))
            .map(|observation| PyObservation(Arc::new(observation)))
            .map_err(refuse)
    }

    /// Name of the drone.
    #[getter]
    fn drone(&self) -> &str {
        self.0.drone()
    }

    /// When the image was exposed, nanoseconds since the Unix epoch.
    #[getter]
    fn stamp_ns(&self) -> i64 {
        self.0.stamp_ns()
    }

    /// `Terrain.fingerprint` of the terrain that the ids are meant for.
    #[getter]
    fn terrain_fingerprint(&self) -> u64 {
        self.0.terrain().fingerprint
    }

    /// Voxels seen [V] int64, sorted.
    #[getter]
    fn voxel_ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        id_array(py, self.0.voxel_ids())
    }

    /// m_i [V] float64: mean heatmap value over the pixels whose ray first hits the voxel.
    #[getter]
    fn mean<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.0.mean().to_vec().into_pyarray(py)
    }

    /// Those pixels [V] int64; 0 for a voxel that is in view but between the pixel centres.
    #[getter]
    fn pixel_count<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        id_array(py, self.0.pixel_count())
    }

    /// From the camera to the voxel's centre [V] float32, metres.
    #[getter]
    fn range_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        self.0.range_m().to_vec().into_pyarray(py)
    }

    /// Of that line, below the horizon [V] float32, degrees: 90 is straight down, negative is upwards.
    #[getter]
    fn tilt_deg<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        self.0.tilt_deg().to_vec().into_pyarray(py)
    }

    /// Voxels inside the image and in range that something hides [O] int64, sorted. Empty for coverage
    /// "rays".
    #[getter]
    fn occluded_ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        id_array(py, self.0.occluded_ids())
    }

    /// Where the crowd in the picture went: heatmap value of the pixels above the crowd threshold, by what
    /// their rays met.
    #[getter]
    fn crowd_mass(&self) -> PyCrowdMass {
        PyCrowdMass(self.0.crowd_mass())
    }

    /// Focal length of the camera in pixels; 0 = nobody said.
    #[getter]
    fn focal_px(&self) -> f32 {
        self.0.focal_px()
    }

    /// The observation as bytes, with a checksum, for other machines and other versions of this
    /// library.
    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &released(py, || self.0.to_bytes()))
    }

    /// The observation that `to_bytes` wrote. MapFileError for bytes that are damaged, of another kind
    /// or of a newer version, CrowdfenceError where their content breaks a promise of an observation.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, data: Cow<'_, [u8]>) -> PyResult<Self> {
        released(py, || Observation::from_bytes(&data))
            .map(|observation| PyObservation(Arc::new(observation)))
            .map_err(refuse)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((slf.get_type().getattr("from_bytes")?, (slf.get().to_bytes(slf.py()),)))
    }

    fn __len__(&self) -> usize {
        self.0.voxel_ids().len()
    }

    fn __repr__(&self) -> String {
        format!(
            "Observation({:?}, stamp_ns={}, {} voxels seen, {} occluded, {})",
            self.drone(),
            self.stamp_ns(),
            self.__len__(),
            self.0.occluded_ids().len(),
            self.crowd_mass().__repr__()
        )
    }
}

/// Pixel counts [V]; one that is no count becomes a CrowdfenceError.
fn counts(values: &Bound<'_, PyAny>) -> PyResult<Vec<u32>> {
    let count = |value: i64| {
        let refused = || CrowdfenceError::new_err(format!("pixel_count is {value}; it must be in [0, 2^32)"));
        u32::try_from(value).map_err(|_| refused())
    };
    Array::<i64>::new(values, "pixel_count", &[None])?.to_vec()?.into_iter().map(count).collect()
}

pub fn projection(
    max_range_m: f64,
    target_height_m: f64,
    coverage: &str,
    surface: &str,
) -> PyResult<Projection> {
    let coverage = match coverage {
        "rays" => Coverage::Rays,
        "full" => Coverage::Full,
        _ => {
            return Err(CrowdfenceError::new_err(format!(
                "coverage is {coverage:?}; it must be \"rays\" or \"full\""
            )));
        }
    };
    let surface = self::surface(surface)?;
    Projection::new(max_range_m, target_height_m, coverage).map(|it| it.with_surface(surface)).map_err(refuse)
}

pub fn surface(name: &str) -> PyResult<Surface> {
    match name {
        "planes" => Ok(Surface::Planes),
        "voxels" => Ok(Surface::Voxels),
        _ => {
            Err(CrowdfenceError::new_err(format!("surface is {name:?}; it must be \"planes\" or \"voxels\"")))
        }
    }
}

/// Back-project a view onto the terrain: mean heatmap value per visible voxel.
///
/// max_range_m      > 0, rays end here
/// target_height_m  in [0, 100], height above the ground at which people are marked
/// coverage         "full": every voxel of which the top is in view, also between the pixels, and which are
///                  occluded; "rays": the voxels first hit by the ray of some pixel centre, as in the paper
/// surface          "planes": where in the voxels the map says that the surface lies; "voxels": the voxels as
///                  cubes, as in the paper, up to a voxel too high. At a hole or the edge of the map, pixels
///                  of the open side of a plane's voxel raise its mean, and never lower it
/// crowd_threshold  in [0, 1], as a rule the method's b_threshold: pixels with a larger heatmap value show
///                  crowd, and `Observation.crowd_mass` says where it went; it decides nothing else
///
/// A camera inside the terrain, or one that `target_height_m` would push through it, sees nothing.
/// CrowdfenceError for a parameter out of bounds.
#[pyfunction]
#[pyo3(signature = (view, terrain, *, max_range_m, target_height_m=0.0, coverage="full", surface="planes", crowd_threshold=0.5))]
#[allow(clippy::too_many_arguments)] // They are keywords in Python.
pub fn project(
    py: Python<'_>,
    view: &PyView,
    terrain: &PyTerrain,
    max_range_m: f64,
    target_height_m: f64,
    coverage: &str,
    surface: &str,
    crowd_threshold: f64,
) -> PyResult<PyObservation> {
    let projection = projection(max_range_m, target_height_m, coverage, surface)?;
    let projection = projection.with_crowd_threshold(crowd_threshold).map_err(refuse)?;
    let observation = released(py, || crowdfence::project(&view.0, &terrain.terrain, &projection));
    Ok(PyObservation(Arc::new(observation)))
}
