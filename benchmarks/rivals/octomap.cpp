// OctoMap: castRay through the voxels of crowdfence.
#include <octomap/octomap.h>

#include "rival.h"

class OctoMap {
    const Columns& columns;
    octomap::OcTree tree;

public:
    explicit OctoMap(const Columns& columns) : columns(columns), tree(columns.voxel_m) {
        constexpr int ORIGIN = 1 << 15; // key of coordinate 0
        const float occupied = tree.getClampingThresMaxLog();
        for (uint32_t i = 0; i < columns.nx; ++i)
            for (uint32_t j = 0; j < columns.ny; ++j) {
                const size_t column = size_t(i) * columns.ny + j;
                for (uint32_t at = columns.start[column]; at < columns.start[column + 1]; ++at)
                    tree.setNodeValue(octomap::OcTreeKey(octomap::key_type(ORIGIN + i), octomap::key_type(ORIGIN + j),
                                                         octomap::key_type(ORIGIN + columns.level[at])),
                                      occupied, true);
            }
        tree.updateInnerOccupancy();
    }

    void trace(const std::string&, const Camera& camera, int first, int last, uint32_t* cells) const {
        const octomap::point3d origin(camera.origin.x, camera.origin.y, camera.origin.z);
        for (int v = first; v < last; ++v)
            for (int u = 0; u < camera.width; ++u) {
                const Vec direction = camera.ray(u, v);
                octomap::point3d hit; // centre of the voxel
                if (tree.castRay(origin, {direction.x, direction.y, direction.z}, hit, true, MAX_RANGE_M))
                    cells[v * camera.width + u] = columns.cell_at(hit.x(), hit.y(), hit.z());
            }
    }
};

int main(int, char** arguments) {
    const std::string folder = arguments[1];
    const Columns columns(folder);
    const double start = wall_ms();
    const OctoMap rival(columns);
    obey(rival, folder, columns.level.size(), (wall_ms() - start) / 1e3);
}
