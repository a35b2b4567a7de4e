// The edge's kernel without Python: reads networks and observations from standard input, runs each on every path that this
// processor has, and writes what each layer gave.
//
// In (int32 and bytes, little-endian): count of layers; of each in_size, in_channels, kernel, stride, outputs; of each its
// signs as int8; of each but the last its thresholds; count of observations; their pixels. Until the end of input.
// Out, lines: path, variant, then the activation bits of a layer as 0 and 1, or the last layer's outputs.
#include <cstdio>
#include <vector>

#include "paths.h"
#include "packed_network.h"

namespace {

template <class Value>
std::vector<Value> read(size_t count) {
  std::vector<Value> values(count);
  values.resize(std::fread(values.data(), sizeof(Value), count, stdin));
  return values;
}

void print(const char* path, const char* variant, const bpn::PackedNetwork& network, const bpn::Activations& out) {
  const auto& shapes = network.shapes();
  for (size_t l = 0; l + 1 < shapes.size(); ++l) {
    const int bytes = (shapes[l].outputs + 7) / 8;
    std::printf("%s %s ", path, variant);
    for (int p = 0; p < shapes[l].out_size * shapes[l].out_size; ++p)
      for (int k = 0; k < shapes[l].outputs; ++k)
        std::putchar('0' + (out.maps[l][p * bytes + k / 8] >> (k % 8) & 1));
    std::putchar('\n');
  }
  std::printf("%s %s", path, variant);
  for (int a = 0; a < shapes.back().outputs; ++a)
    std::printf(" %lld", bpn::fan_in(shapes.back()) - 2 * static_cast<long long>(out.differences[a]));
  std::putchar('\n');
}

bool run_one() {
  const auto count = read<int32_t>(1);
  if (count.empty()) return false;
  std::vector<bpn::LayerShape> shapes;
  for (int l = 0; l < count[0]; ++l) {
    const auto s = read<int32_t>(5);
    shapes.push_back({s[0], s[1], s[2], s[3], (s[0] - s[2]) / s[3] + 1, s[4]});
  }
  std::vector<std::vector<int8_t>> signs;
  std::vector<std::vector<int32_t>> thresholds;
  for (const auto& shape : shapes) signs.push_back(read<int8_t>(size_t(shape.outputs) * bpn::fan_in(shape)));
  for (size_t l = 0; l + 1 < shapes.size(); ++l) thresholds.push_back(read<int32_t>(shapes[l].outputs));
  std::vector<bpn::SignMatrix> matrices;
  for (size_t l = 0; l < shapes.size(); ++l)
    matrices.push_back({signs[l].data(), l < thresholds.size() ? thresholds[l].data() : nullptr});
  if (!bpn::is_chain(shapes)) return false;
  const bpn::PackedNetwork network(shapes, matrices);
  const bpn::Memory scratch(network.scratch_size());
  const size_t pixels = size_t(shapes[0].in_channels) * shapes[0].in_size * shapes[0].in_size;
  for (int observations = read<int32_t>(1)[0]; observations > 0; --observations) {
    const auto observation = read<uint8_t>(pixels);
    const bpn::PathList paths = bpn::compiled_paths();
    for (const bpn::Path* path = paths.first; path != paths.first + paths.count; ++path) {
      if (!path->supported()) continue;
      const bpn::Activations out = network.activations(scratch.data());
      path->any(network.layers(), observation.data(), out);
      print(path->name, "any", network, out);
      if (network.is_paper()) {
        path->paper(network.layers(), observation.data(), out);
        print(path->name, "paper", network, out);
      }
    }
  }
  return true;
}

}  // namespace

int main() {
  while (run_one()) {
  }
}
