// Embree 3: the height map as two triangles between every four cell centres, and what overhangs it.
#include <embree3/rtcore.h>
#include <pmmintrin.h>
#include <xmmintrin.h>

#include "rival.h"

class Embree {
    const Columns& columns;
    RTCScene traced;

    // Calls fill(vertices, triangles) with Embree's own buffers, which are large.
    template <class Fill> void attach(RTCDevice device, size_t vertices, size_t triangles, Fill fill) {
        RTCGeometry mesh = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
        void* to_vertices = rtcSetNewGeometryBuffer(mesh, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, vertices);
        void* to_triangles = rtcSetNewGeometryBuffer(mesh, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, triangles);
        fill(static_cast<float*>(to_vertices), static_cast<uint32_t*>(to_triangles));
        rtcCommitGeometry(mesh);
        rtcAttachGeometry(traced, mesh);
        rtcReleaseGeometry(mesh);
    }

    static void fill_heights(const Scene& scene, float* vertex, uint32_t* triangle) {
        for (uint32_t i = 0; i < scene.nx; ++i)
            for (uint32_t j = 0; j < scene.ny; ++j) {
                const float height = scene.height[size_t(i) * scene.ny + j];
                *vertex++ = float((i + 0.5) * scene.cell_m), *vertex++ = float((j + 0.5) * scene.cell_m);
                *vertex++ = std::isnan(height) ? 0 : height;
            }
        const auto add = [&](uint32_t a, uint32_t b, uint32_t c) {
            const bool is_hole = std::isnan(scene.height[a] + scene.height[b] + scene.height[c]);
            *triangle++ = a, *triangle++ = is_hole ? a : b, *triangle++ = is_hole ? a : c;
        };
        for (uint32_t i = 0; i + 1 < scene.nx; ++i)
            for (uint32_t j = 0; j + 1 < scene.ny; ++j) {
                const uint32_t at = i * scene.ny + j, beyond = at + scene.ny;
                add(at, beyond, beyond + 1), add(at, beyond + 1, at + 1);
            }
    }

    template <class Ray> static void aim(Ray& ray, const Camera& camera, int u, int v) {
        const Vec direction = camera.ray(u, v);
        ray.ray.org_x = camera.origin.x, ray.ray.org_y = camera.origin.y, ray.ray.org_z = camera.origin.z;
        ray.ray.dir_x = direction.x, ray.ray.dir_y = direction.y, ray.ray.dir_z = direction.z;
        ray.ray.tnear = 0, ray.ray.tfar = MAX_RANGE_M, ray.ray.time = 0, ray.ray.mask = ~0u, ray.ray.flags = 0;
        ray.hit.geomID = RTC_INVALID_GEOMETRY_ID, ray.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    }

    uint32_t cell(const RTCRay& ray, unsigned geometry) const {
        if (geometry == RTC_INVALID_GEOMETRY_ID) return NO_CELL;
        return columns.cell_at(ray.org_x + ray.tfar * ray.dir_x, ray.org_y + ray.tfar * ray.dir_y,
                               ray.org_z + ray.tfar * ray.dir_z);
    }

    void trace_single(const Camera& camera, int first, int last, uint32_t* cells) const {
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
        for (int v = first; v < last; ++v)
            for (int u = 0; u < camera.width; ++u) {
                RTCRayHit ray;
                aim(ray, camera, u, v);
                rtcIntersect1(traced, &context, &ray);
                cells[v * camera.width + u] = cell(ray.ray, ray.hit.geomID);
            }
    }

    // Packets of 4 x 4 pixels; all image sides are multiples of 4.
    void trace_packets(const Camera& camera, int first, uint32_t* cells) const {
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
        alignas(64) int valid[16];
        std::fill(valid, valid + 16, -1);
        for (int left = 0; left < camera.width; left += 4) {
            alignas(64) RTCRayHit16 packet;
            for (int k = 0; k < 16; ++k) {
                const Vec direction = camera.ray(left + k % 4, first + k / 4);
                RTCRay16& ray = packet.ray;
                ray.org_x[k] = camera.origin.x, ray.org_y[k] = camera.origin.y, ray.org_z[k] = camera.origin.z;
                ray.dir_x[k] = direction.x, ray.dir_y[k] = direction.y, ray.dir_z[k] = direction.z;
                ray.tnear[k] = 0, ray.tfar[k] = MAX_RANGE_M, ray.time[k] = 0, ray.mask[k] = ~0u, ray.flags[k] = 0;
                packet.hit.geomID[k] = packet.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
            }
            rtcIntersect16(valid, traced, &context, &packet);
            for (int k = 0; k < 16; ++k) {
                const RTCRay16& ray = packet.ray;
                const Vec hit = camera.at({ray.dir_x[k], ray.dir_y[k], ray.dir_z[k]}, ray.tfar[k]);
                const bool is_hit = packet.hit.geomID[k] != RTC_INVALID_GEOMETRY_ID;
                cells[(first + k / 4) * camera.width + left + k % 4] =
                    is_hit ? columns.cell_at(hit.x, hit.y, hit.z) : NO_CELL;
            }
        }
    }

    void trace_stream(const Camera& camera, int first, uint32_t* cells) const {
        constexpr int WIDE = 32, TALL = 4;
        RTCIntersectContext context;
        rtcInitIntersectContext(&context);
        context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
        RTCRayHit rays[WIDE * TALL];
        for (int left = 0; left < camera.width; left += WIDE) {
            const int wide = std::min(WIDE, camera.width - left);
            for (int k = 0; k < wide * TALL; ++k) aim(rays[k], camera, left + k % wide, first + k / wide);
            rtcIntersect1M(traced, &context, rays, unsigned(wide * TALL), sizeof(RTCRayHit));
            for (int k = 0; k < wide * TALL; ++k)
                cells[(first + k / wide) * camera.width + left + k % wide] = cell(rays[k].ray, rays[k].hit.geomID);
        }
    }

public:
    Embree(const Scene& scene, const Columns& columns) : columns(columns) {
        RTCDevice device = rtcNewDevice(nullptr);
        traced = rtcNewScene(device);
        const size_t cells = size_t(scene.nx - 1) * (scene.ny - 1);
        attach(device, scene.height.size(), 2 * cells,
               [&](float* vertices, uint32_t* triangles) { fill_heights(scene, vertices, triangles); });
        if (!scene.triangles.empty())
            attach(device, scene.vertices.size() / 3, scene.triangles.size() / 3,
                   [&](float* vertices, uint32_t* triangles) {
                       std::copy(scene.vertices.begin(), scene.vertices.end(), vertices);
                       std::copy(scene.triangles.begin(), scene.triangles.end(), triangles);
                   });
        rtcCommitScene(traced);
    }

    void trace(const std::string& mode, const Camera& camera, int first, int last, uint32_t* cells) const {
        // What Embree's manual asks of threads that trace.
        _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
        _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
        if (mode == "Intersect1") trace_single(camera, first, last, cells);
        else if (mode == "Intersect16") trace_packets(camera, first, cells);
        else trace_stream(camera, first, cells);
    }
};

int main(int, char** arguments) {
    const std::string folder = arguments[1];
    const Columns columns(folder);
    const double start = wall_ms();
    const Embree embree(Scene{folder}, columns);
    obey(embree, folder, columns.level.size(), (wall_ms() - start) / 1e3);
}
