// What every C++ rival shares: the scene's files (scene.py says how they look), the stages after the rays, and the
// loop that takes orders from run.py. A rival adds how it is built and how rays become cells.
#pragma once
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <sys/resource.h>
#include <time.h>

constexpr uint32_t NO_CELL = ~0u;
constexpr float MAX_RANGE_M = 300.0f;

// ------------------------------------------------------------------------------------------------ files

struct File {
    std::ifstream stream;
    explicit File(const std::string& path) : stream(path, std::ios::binary) {
        if (!stream.is_open()) throw std::runtime_error("cannot open " + path);
        stream.exceptions(std::ios::failbit | std::ios::badbit);
    }
    template <class T> T one() { return many<T>(1)[0]; }
    template <class T> std::vector<T> many(size_t count) {
        std::vector<T> values(count);
        stream.read(reinterpret_cast<char*>(values.data()), std::streamsize(count * sizeof(T)));
        return values;
    }
};

struct Scene {
    uint32_t nx, ny;
    double cell_m;
    std::vector<float> height, vertices;
    std::vector<uint32_t> triangles;

    explicit Scene(const std::string& folder) {
        File file(folder + "/scene.bin");
        nx = file.one<uint32_t>(), ny = file.one<uint32_t>(), cell_m = file.one<double>();
        const auto vertex_count = file.one<uint64_t>(), triangle_count = file.one<uint64_t>();
        height = file.many<float>(size_t(nx) * ny);
        vertices = file.many<float>(3 * vertex_count);
        triangles = file.many<uint32_t>(3 * triangle_count);
    }
};

// The voxels of crowdfence, column by column: cell ids count them in this order. Tracers of voxels are built from
// it; for tracers of triangles it turns a point of the surface into a cell.
struct Columns {
    uint32_t nx, ny;
    float per_m;
    double voxel_m;
    std::vector<uint32_t> start;
    std::vector<int16_t> level;

    explicit Columns(const std::string& folder) {
        File file(folder + "/columns.bin");
        nx = file.one<uint32_t>(), ny = file.one<uint32_t>(), voxel_m = file.one<double>();
        per_m = float(1 / voxel_m);
        start = file.many<uint32_t>(size_t(nx) * ny + 1);
        level = file.many<int16_t>(start.back());
    }

    // The voxel of this column that is nearest to level k.
    uint32_t cell(uint32_t i, uint32_t j, int k) const {
        if (i >= nx || j >= ny) return NO_CELL;
        const size_t column = size_t(i) * ny + j;
        const uint32_t first = start[column], count = start[column + 1] - first;
        if (count == 0) return NO_CELL;
        const int16_t* levels = &level[first];
        // Most columns have no gap, and then the place follows from the lowest level.
        const uint32_t guess = uint32_t(std::clamp(k - levels[0], 0, int(count) - 1));
        if (levels[guess] == k || count == 1) return first + guess;
        const auto above = uint32_t(std::lower_bound(levels, levels + count, k) - levels);
        if (above == 0) return first;
        if (above == count) return first + count - 1;
        return first + (levels[above] - k < k - levels[above - 1] ? above : above - 1);
    }

    // The voxel nearest to a point of the surface. A mesh leans its walls over half a cell, so the point may lie in
    // the column before the wall: then the neighbour that has a voxel at this height is meant.
    uint32_t cell_at(float x, float y, float z) const {
        if (!(x >= 0 && y >= 0)) return NO_CELL;
        const auto i = uint32_t(x * per_m), j = uint32_t(y * per_m);
        const int k = int(std::floor(z * per_m));
        uint32_t best = cell(i, j, k);
        const auto off = [&](uint32_t cell) { return cell == NO_CELL ? INT32_MAX : std::abs(level[cell] - k); };
        if (off(best) > 1)
            for (const uint32_t beside : {cell(i + 1, j, k), cell(i - 1, j, k), cell(i, j + 1, k), cell(i, j - 1, k)})
                if (off(beside) < off(best)) best = beside;
        return best;
    }
};

struct Vec { float x, y, z; };

// Pinhole without distortion: the ray of pixel (u, v) is corner + u * right + v * below.
struct Camera {
    int width, height;
    Vec origin, corner, right, below;

    Camera(const double* pose, int width, int height, double focal_px) : width(width), height(height) {
        const auto turned = [&](double x, double y, double z) {
            const auto row = [&](int r) { return float(pose[4 * r] * x + pose[4 * r + 1] * y + pose[4 * r + 2] * z); };
            return Vec{row(0), row(1), row(2)};
        };
        origin = {float(pose[3]), float(pose[7]), float(pose[11])};
        corner = turned((0.5 - width / 2.0) / focal_px, (0.5 - height / 2.0) / focal_px, 1.0);
        right = turned(1 / focal_px, 0, 0), below = turned(0, 1 / focal_px, 0);
    }
    Vec ray(int u, int v) const { // length 1
        const float x = corner.x + float(u) * right.x + float(v) * below.x;
        const float y = corner.y + float(u) * right.y + float(v) * below.y;
        const float z = corner.z + float(u) * right.z + float(v) * below.z;
        const float scale = 1 / std::sqrt(x * x + y * y + z * z);
        return {x * scale, y * scale, z * scale};
    }
    Vec at(const Vec& ray, float t) const {
        return {origin.x + t * ray.x, origin.y + t * ray.y, origin.z + t * ray.z};
    }
};

struct View {
    Camera camera;
    const float* heatmap;
};

struct Views {
    std::vector<float> heatmaps;
    std::vector<View> all;

    Views(const std::string& folder, const std::string& name, int width, int height) {
        const std::string size = std::to_string(width) + "x" + std::to_string(height);
        File heat(folder + "/../heatmaps-" + size + ".bin"), file(folder + "/" + name + ".bin");
        const size_t pixels = size_t(width) * height, pictures = 12;
        for (uint8_t value : heat.many<uint8_t>(pictures * pixels)) heatmaps.push_back(float(value) / 255.0f);
        const auto count = file.one<uint32_t>();
        const auto focal_px = file.one<double>() * width;
        const auto poses = file.many<double>(size_t(count) * 12);
        for (size_t i = 0; i < count; ++i)
            all.push_back({Camera(&poses[12 * i], width, height, focal_px), &heatmaps[i % pictures * pixels]});
    }
};

// ------------------------------------------------------------------------------------------------ stages

// Zeroed memory that exists only where it was touched.
template <class T> struct Zeroed {
    std::unique_ptr<T, decltype(&std::free)> memory{nullptr, std::free};
    explicit Zeroed(size_t count) : memory(static_cast<T*>(std::calloc(count, sizeof(T))), std::free) {}
    T& operator[](size_t at) { return memory.get()[at]; }
};

struct Seen {
    uint32_t cell, pixels;
    float mean;
};

// Mean heatmap value of each cell: sums in a map-sized array, which is left clean.
struct Averager {
    struct Sum { float value; uint32_t pixels; };
    Zeroed<Sum> sums;
    explicit Averager(size_t cells) : sums(cells) {}

    void average(const uint32_t* cells, const float* heatmap, size_t pixels, std::vector<Seen>& seen) {
        seen.clear();
        for (size_t pixel = 0; pixel < pixels; ++pixel) {
            const uint32_t cell = cells[pixel];
            if (cell == NO_CELL) continue;
            Sum& sum = sums[cell];
            if (sum.pixels++ == 0) seen.push_back({cell, 0, 0});
            sum.value += heatmap[pixel];
        }
        for (Seen& look : seen) {
            Sum& sum = sums[look.cell];
            look.pixels = sum.pixels, look.mean = sum.value / float(sum.pixels);
            sum = {0, 0};
        }
    }
};

// Equations 1-3 on the cells touched. Belief is kept as P~ exp(lambda t), so that decay costs nothing per cell.
struct Fusion {
    static constexpr double TRUE_POSITIVE = 0.9, FALSE_POSITIVE = 0.05, PRIOR = 0.2;
    static constexpr double ALPHA = 0.1, DECAY_PER_S = 0.05, THRESHOLD = 0.5;
    struct Pool { float probability; uint32_t instant; };
    Zeroed<double> belief;
    Zeroed<Pool> pools;
    std::vector<uint32_t> touched;
    uint32_t instant = 0;
    double growth = 1;

    explicit Fusion(size_t cells) : belief(cells), pools(cells) {}

    static double posterior(double given_crowd, double given_none) {
        return given_crowd * PRIOR / (given_crowd * PRIOR + given_none * (1 - PRIOR));
    }
    void fuse(const std::vector<std::vector<Seen>>& looks, double stamp_s) {
        static const float crowd = float(posterior(TRUE_POSITIVE, FALSE_POSITIVE));
        static const float none = float(posterior(1 - TRUE_POSITIVE, 1 - FALSE_POSITIVE));
        const float fleet = float(looks.size());
        touched.clear(), ++instant, growth = std::exp(DECAY_PER_S * stamp_s);
        for (const auto& view : looks)
            for (const Seen& look : view) {
                Pool& pool = pools[look.cell];
                if (pool.instant != instant) pool = {none, instant}, touched.push_back(look.cell);
                const float weight = std::fabs(look.mean - 0.5f) / 0.5f;
                // A drone that does not look counts with m = 0: its share gives way to that of this look.
                pool.probability += (weight * (look.mean > THRESHOLD ? crowd : none) - none) / fleet;
            }
        for (uint32_t cell : touched)
            belief[cell] = ALPHA * growth * double(pools[cell].probability) + (1 - ALPHA) * belief[cell];
    }
    double probability(uint32_t cell) { return belief[cell] / growth; }
};

// ------------------------------------------------------------------------------------------------ orders

inline double clock_ms(clockid_t id) {
    timespec now;
    clock_gettime(id, &now);
    return double(now.tv_sec) * 1e3 + double(now.tv_nsec) * 1e-6;
}
inline double cpu_ms() { return clock_ms(CLOCK_PROCESS_CPUTIME_ID); }
inline double wall_ms() { return clock_ms(CLOCK_MONOTONIC); }

template <class Work> void parallel(int threads, int count, Work work) {
    std::atomic<int> next{0};
    const auto run = [&](int thread) {
        for (int at; (at = next++) < count;) work(at, thread);
    };
    std::vector<std::thread> others;
    for (int thread = 1; thread < std::min(threads, count); ++thread) others.emplace_back(run, thread);
    run(0);
    for (std::thread& other : others) other.join();
}

struct Times { double rays = 0, average = 0, fuse = 0, cpu = 0, wall = 0; };

// `Rival` has trace(mode, camera, first row, last row, cells): the cell of every pixel of those rows.
template <class Rival> class Bench {
    static constexpr int STRIP = 4;
    const Rival& rival;
    Fusion fusion;
    std::vector<Averager> averagers;
    std::vector<std::vector<uint32_t>> cells;
    std::vector<std::vector<Seen>> looks;
    double stamp_s = 0;

    // Of a slow rival only every `step`th row is traced.
    void rays(const std::string& mode, const Camera& camera, uint32_t* cells, int threads, int step) {
        const int rows = step > 1 ? 1 : STRIP;
        parallel(threads, camera.height / (rows * step), [&](int strip, int) {
            const int first = step > 1 ? strip * step + step / 2 : strip * rows;
            rival.trace(mode, camera, first, std::min(first + rows, camera.height), cells);
        });
    }

public:
    Bench(const Rival& rival, size_t cell_count, int threads) : rival(rival), fusion(cell_count) {
        for (int thread = 0; thread < threads; ++thread) averagers.emplace_back(cell_count);
    }

    Times instant(const std::string& mode, const View* views, int drones, int threads, int step) {
        const size_t pixels = size_t(views->camera.width) * views->camera.height;
        cells.resize(std::min(drones, threads));
        for (auto& of_thread : cells) of_thread.assign(pixels, NO_CELL);
        looks.resize(drones);
        Times times;
        const double cpu = cpu_ms(), wall = wall_ms();
        // One drone: the rows are shared out. Several: the drones are.
        parallel(drones > 1 ? threads : 1, drones, [&](int drone, int thread) {
            const double start = cpu_ms();
            rays(mode, views[drone].camera, cells[thread].data(), drones > 1 ? 1 : threads, step);
            const double traced = cpu_ms();
            averagers[thread].average(cells[thread].data(), views[drone].heatmap, pixels, looks[drone]);
            if (threads == 1) times.rays += traced - start, times.average += cpu_ms() - traced;
        });
        const double averaged = cpu_ms();
        fusion.fuse(looks, stamp_s += 0.1);
        times.fuse = cpu_ms() - averaged, times.cpu = cpu_ms() - cpu, times.wall = wall_ms() - wall;
        return times;
    }

    // What no method can save: read the heatmap once, read and write every touched cell once.
    Times floor(const std::string& mode, const View& view) {
        instant(mode, &view, 1, 1, 1);
        std::sort(fusion.touched.begin(), fusion.touched.end());
        const double start = cpu_ms();
        float sums[64] = {}; // many, so that no addition waits for the one before
        const size_t pixels = size_t(view.camera.width) * view.camera.height;
        for (size_t pixel = 0; pixel < pixels; pixel += 64)
            for (size_t k = 0; k < 64; ++k) sums[k] += view.heatmap[pixel + k];
        for (uint32_t cell : fusion.touched) fusion.belief[cell] = 0.9 * fusion.belief[cell] + 1e-9 * sums[cell % 64];
        Times times;
        times.cpu = cpu_ms() - start;
        return times;
    }

    size_t touched() const { return fusion.touched.size(); }

    // Per cell of one view: u32 cell, u32 pixels, f32 mean, f32 probability after this first instant.
    void dump(const std::string& path) {
        std::ofstream file(path, std::ios::binary);
        for (const Seen& look : looks[0]) {
            const float probability = float(fusion.probability(look.cell));
            file.write(reinterpret_cast<const char*>(&look), sizeof look);
            file.write(reinterpret_cast<const char*>(&probability), sizeof probability);
        }
    }
};

// One order a line, one answer a line:
//   time <mode> <views> <width> <height> <drones> <threads> <step> <instants>
//   dump <mode> <views> <width> <height> <view> <path>
template <class Rival> void obey(const Rival& rival, const std::string& folder, size_t cell_count, double build_s) {
    rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    std::cout << "{\"build_s\": " << build_s << ", \"peak_mb\": " << double(usage.ru_maxrss) / 1024 << "}" << std::endl;
    std::unique_ptr<Bench<Rival>> bench;
    std::unique_ptr<Views> views;
    std::string line, shown;
    while (std::getline(std::cin, line)) {
        std::istringstream words(line);
        std::string order, mode, name, path;
        int width, height, drones = 1, threads = 1, step = 1, instants = 1, view = 0;
        words >> order >> mode >> name >> width >> height;
        const std::string wanted = name + std::to_string(width);
        if (wanted != shown) views = std::make_unique<Views>(folder, name, width, height), shown = wanted;
        if (order == "dump") {
            words >> view >> path;
            Bench<Rival> fresh(rival, cell_count, 1);
            fresh.instant(mode, &views->all[view], 1, 1, 1);
            fresh.dump(path);
            std::cout << "{}" << std::endl;
            continue;
        }
        words >> drones >> threads >> step >> instants;
        if (!bench) bench = std::make_unique<Bench<Rival>>(rival, cell_count, 2);
        std::ostringstream answer;
        for (int at = 0; at < instants; ++at) {
            const View* first = &views->all[at * drones];
            const Times times = order == "floor" ? bench->floor(mode, *first)
                                                 : bench->instant(mode, first, drones, threads, step);
            answer << (at ? ", " : "[") << "{\"rays\": " << times.rays << ", \"average\": " << times.average
                   << ", \"fuse\": " << times.fuse << ", \"cpu\": " << times.cpu << ", \"wall\": " << times.wall
                   << ", \"touched\": " << bench->touched() << "}";
        }
        std::cout << answer.str() << "]" << std::endl;
    }
}
