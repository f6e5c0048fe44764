// Builds a level set with OpenVDB and measures it as `prosopon bench field --points` measures Prosopon's fields.
// Arguments: --mesh M --points P --out O --timing T --band-mm B --margin-mm (ignored) --spacing-mm H.
// M: counts of vertices and triangles (u64), x y z (f64), corners (u32); P: count (u64), x y z (f64); O: distances (f64).
#include <openvdb/openvdb.h>
#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/MeshToVolume.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <limits>
#include <map>
#include <random>
#include <string>
#include <sys/resource.h>
#include <vector>

namespace {

template <typename T> std::vector<T> numbers(std::istream &in, size_t count) {
    std::vector<T> found(count);
    in.read(reinterpret_cast<char *>(found.data()), std::streamsize(count * sizeof(T)));
    if (!in) throw std::runtime_error("an input file is shorter than its counts say");
    return found;
}

double status_mb(const std::string &name) {
    std::ifstream file("/proc/self/status");
    for (std::string line; std::getline(file, line);)
        if (line.rfind(name, 0) == 0) return std::stod(line.substr(name.size())) * 1.024e-3;
    return 0.0;
}

double cpu_s() {
    rusage used;
    getrusage(RUSAGE_SELF, &used);
    auto seconds = [](const timeval &t) { return double(t.tv_sec) + 1e-6 * double(t.tv_usec); };
    return seconds(used.ru_utime) + seconds(used.ru_stime);
}

double now_s() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// The points in the order of the Morton curve over their bounding box.
std::vector<openvdb::Vec3d> along_a_curve(const std::vector<openvdb::Vec3d> &points) {
    openvdb::Vec3d low = points[0], high = points[0];
    for (const auto &p : points) low = openvdb::math::minComponent(low, p), high = openvdb::math::maxComponent(high, p);
    const auto size = high - low;
    const double scale = 1023.0 / std::max({size[0], size[1], size[2]});
    std::vector<std::pair<uint32_t, size_t>> keyed;
    for (size_t n = 0; n < points.size(); ++n) {
        uint32_t key = 0;
        for (int bit = 0; bit < 10; ++bit)
            for (int a = 0; a < 3; ++a)
                key |= (uint32_t((points[n][a] - low[a]) * scale) >> bit & 1u) << (3 * bit + a);
        keyed.emplace_back(key, n);
    }
    std::sort(keyed.begin(), keyed.end());
    std::vector<openvdb::Vec3d> sorted;
    for (const auto &k : keyed) sorted.push_back(points[k.second]);
    return sorted;
}

// Mean time to query a value in the best of three rounds, ns.
double query_ns(const openvdb::FloatGrid &grid, const std::vector<openvdb::Vec3d> &points) {
    double best = std::numeric_limits<double>::infinity(), sum = 0.0;
    for (int round = 0; round < 3; ++round) {
        auto accessor = grid.getConstAccessor();
        openvdb::tools::GridSampler<openvdb::FloatGrid::ConstAccessor, openvdb::tools::BoxSampler> at(accessor, grid.transform());
        const double start = now_s();
        for (const auto &p : points) sum += at.wsSample(p);
        best = std::min(best, (now_s() - start) * 1e9 / double(points.size()));
    }
    // Uses the sum, so that the compiler does not remove the loop.
    if (sum == 0.5) std::cerr << sum;
    return best;
}

} // namespace

int main(int argc, char **argv) try {
    std::map<std::string, std::string> option;
    for (int i = 1; i + 1 < argc; i += 2) option[argv[i]] = argv[i + 1];
    openvdb::initialize();
    std::ifstream mesh(option.at("--mesh"), std::ios::binary), input(option.at("--points"), std::ios::binary);
    const auto counts = numbers<uint64_t>(mesh, 2);
    const auto coordinates = numbers<double>(mesh, 3 * counts[0]);
    const auto corners = numbers<uint32_t>(mesh, 3 * counts[1]);
    std::vector<openvdb::Vec3s> vertices;
    for (size_t n = 0; n < counts[0]; ++n)
        vertices.emplace_back(coordinates[3 * n], coordinates[3 * n + 1], coordinates[3 * n + 2]);
    std::vector<openvdb::Vec3I> triangles;
    for (size_t n = 0; n < counts[1]; ++n) triangles.emplace_back(corners[3 * n], corners[3 * n + 1], corners[3 * n + 2]);
    const auto n_points = numbers<uint64_t>(input, 1)[0];
    const auto xyz = numbers<double>(input, 3 * n_points);
    std::vector<openvdb::Vec3d> points;
    for (size_t n = 0; n < n_points; ++n) points.emplace_back(xyz[3 * n], xyz[3 * n + 1], xyz[3 * n + 2]);

    const double spacing = std::stod(option.at("--spacing-mm"));
    const float band = float(std::stod(option.at("--band-mm")) / spacing);
    const auto transform = openvdb::math::Transform::createLinearTransform(spacing);
    std::ofstream("/proc/self/clear_refs") << 5;
    const double before_mb = status_mb("VmRSS:");
    openvdb::FloatGrid::Ptr grid;
    double wall = std::numeric_limits<double>::infinity(), cpu = 0.0, peak_mb = 0.0;
    for (int round = 0; round < 3; ++round) {
        grid.reset();
        const double start = now_s(), start_cpu = cpu_s();
        grid = openvdb::tools::meshToSignedDistanceField<openvdb::FloatGrid>(*transform, vertices, triangles, {}, band, band);
        if (now_s() - start < wall) wall = now_s() - start, cpu = cpu_s() - start_cpu;
        if (round == 0) peak_mb = status_mb("VmHWM:") - before_mb;
    }

    std::vector<double> distances;
    auto accessor = grid->getConstAccessor();
    openvdb::tools::GridSampler<openvdb::FloatGrid::ConstAccessor, openvdb::tools::BoxSampler> at(accessor, grid->transform());
    for (const auto &p : points) distances.push_back(at.wsSample(p));
    std::ofstream out(option.at("--out"), std::ios::binary);
    out.write(reinterpret_cast<const char *>(distances.data()), std::streamsize(distances.size() * sizeof(double)));
    auto shuffled = points;
    std::shuffle(shuffled.begin(), shuffled.end(), std::mt19937(1));
    std::ofstream timing(option.at("--timing"));
    timing << "{\"spacing_mm\":" << spacing << ",\"build_wall_s\":" << wall << ",\"build_cpu_s\":" << cpu
           << ",\"memory_mb\":" << double(grid->memUsage()) * 1e-6 << ",\"peak_mb\":" << peak_mb
           << ",\"query_sorted_ns\":" << query_ns(*grid, along_a_curve(points))
           << ",\"query_random_ns\":" << query_ns(*grid, shuffled)
           << ",\"hessian_sorted_ns\":null,\"hessian_random_ns\":null}";
    return out && timing ? 0 : 1;
} catch (const std::exception &e) {
    std::cerr << e.what() << '\n';
    return 1;
}
