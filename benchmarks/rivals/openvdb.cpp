// OpenVDB: VolumeRayIntersector finds the leaves on a ray, a DDA the first active voxel in them. The value of a voxel
// is its cell.
#include <openvdb/math/DDA.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/RayIntersector.h>

#include "rival.h"

class OpenVdb {
    using Grid = openvdb::Int32Grid;
    using Intersector = openvdb::tools::VolumeRayIntersector<Grid>;
    using Ray = Intersector::RayType;
    Grid::Ptr grid;
    std::unique_ptr<Intersector> intersector;
    double per_m;

    static Grid::Ptr grid_of(const Columns& columns) {
        Grid::Ptr grid = Grid::create(-1);
        auto accessor = grid->getAccessor();
        for (uint32_t i = 0; i < columns.nx; ++i)
            for (uint32_t j = 0; j < columns.ny; ++j) {
                const size_t column = size_t(i) * columns.ny + j;
                for (uint32_t at = columns.start[column]; at < columns.start[column + 1]; ++at)
                    accessor.setValue(openvdb::Coord(int(i), int(j), columns.level[at]), int(at));
            }
        return grid;
    }

    uint32_t first_hit(Intersector& leaves, Grid::ConstAccessor& voxels, const Ray& ray) const {
        if (!leaves.setIndexRay(ray)) return NO_CELL;
        for (double enter, leave; leaves.march(enter, leave);) {
            openvdb::math::DDA<Ray> steps(Ray(ray.eye(), ray.dir(), enter, leave));
            do {
                int cell;
                if (voxels.probeValue(steps.voxel(), cell)) return uint32_t(cell);
            } while (steps.step());
        }
        return NO_CELL;
    }

public:
    explicit OpenVdb(const Columns& columns)
        : grid(grid_of(columns)), intersector(std::make_unique<Intersector>(*grid)), per_m(1 / columns.voxel_m) {}

    void trace(const std::string&, const Camera& camera, int first, int last, uint32_t* cells) const {
        Intersector leaves(*intersector); // not to be shared by threads
        auto voxels = grid->getConstAccessor();
        const openvdb::Vec3d eye = openvdb::Vec3d(camera.origin.x, camera.origin.y, camera.origin.z) * per_m;
        for (int v = first; v < last; ++v)
            for (int u = 0; u < camera.width; ++u) {
                const Vec direction = camera.ray(u, v);
                const Ray ray(eye, openvdb::Vec3d(direction.x, direction.y, direction.z), 1e-6, MAX_RANGE_M * per_m);
                cells[v * camera.width + u] = first_hit(leaves, voxels, ray);
            }
    }
};

int main(int, char** arguments) {
    openvdb::initialize();
    const std::string folder = arguments[1];
    const Columns columns(folder);
    const double start = wall_ms();
    const OpenVdb rival(columns);
    obey(rival, folder, columns.level.size(), (wall_ms() - start) / 1e3);
}
