// The Python side of the native kernel: bpn_edge.kernel._native.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <initializer_list>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "packed_network.h"
#include "paths.h"

namespace nb = nanobind;

namespace bpn {
namespace {

using Array = nb::ndarray<nb::ro, nb::device::cpu>;
using Signs = nb::ndarray<const int8_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Thresholds = nb::ndarray<const int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Bits = nb::ndarray<nb::numpy, uint8_t, nb::ndim<1>>;
using MemoryView = nb::ndarray<nb::numpy, uint8_t, nb::ndim<1>>;
using Matrix = nb::ndarray<nb::numpy, int8_t, nb::ndim<2>>;
using Outputs = nb::ndarray<nb::numpy, int32_t, nb::ndim<1>>;

// A numpy array of its own.
template <class Result, class Value>
Result fresh_array(std::unique_ptr<Value[]> values, std::initializer_list<size_t> shape) {
  Value* data = values.release();
  return Result(data, shape, nb::capsule(data, [](void* p) noexcept { delete[] static_cast<Value*>(p); }));
}

Bits unpacked(const uint8_t* map, const LayerShape& shape) {
  const size_t count = size_t(shape.out_size) * shape.out_size * shape.outputs;
  std::unique_ptr<uint8_t[]> bits(new uint8_t[count]);
  unpack_bits(map, shape, bits.get());
  return fresh_array<Bits>(std::move(bits), {count});
}

std::string described(const Array& array) {
  std::string shape;
  for (size_t i = 0; i < array.ndim(); ++i) shape += (i ? ", " : "") + std::to_string(array.shape(i));
  const nb::dlpack::dtype dtype = array.dtype();
  const char* kinds[] = {"int", "uint", "float"};
  const std::string kind = dtype.code < 3 ? kinds[dtype.code] : "other";
  return kind + std::to_string(dtype.bits) + "[" + shape + "]";
}

using Sizes = std::array<int, 5>;  // in_size, in_channels, kernel, stride, outputs

class Network {
 public:
  Network(const std::string& path, bool any_shape, const std::vector<Sizes>& layers, const std::vector<Signs>& weights,
          const std::vector<Thresholds>& thresholds)
      : Network(path, any_shape, std::make_unique<PackedNetwork>(packed(layers, weights, thresholds))) {}

  Outputs run(const Array& observation) const { return outputs(compute(observation)); }

  // Every weight and threshold that is in the memory.
  nb::tuple read_back() const {
    const std::vector<LayerShape>& shapes = packed_->shapes();
    std::vector<std::unique_ptr<int8_t[]>> signs;
    std::vector<std::unique_ptr<int32_t[]>> thresholds;
    std::vector<ReadBack> layers;
    for (const LayerShape& shape : shapes) {
      signs.emplace_back(new int8_t[size_t(shape.outputs) * fan_in(shape)]);
      thresholds.emplace_back(&shape == &shapes.back() ? nullptr : new int32_t[shape.outputs]);
      layers.push_back({signs.back().get(), thresholds.back().get()});
    }
    if (!packed_->read_back(layers)) throw std::runtime_error("the memory holds bits that no packing makes");
    nb::list weights, taus;
    for (size_t l = 0; l < shapes.size(); ++l) {
      const size_t outputs = shapes[l].outputs;
      weights.append(fresh_array<Matrix>(std::move(signs[l]), {outputs, size_t(fan_in(shapes[l]))}));
      if (thresholds[l]) taus.append(fresh_array<Outputs>(std::move(thresholds[l]), {outputs}));
    }
    return nb::make_tuple(weights, taus);
  }

  uint64_t checksum() const { return packed_->checksum(); }

  // The memory itself, for tests that damage it.
  MemoryView memory() { return MemoryView(packed_->memory().data(), {packed_->memory().size()}, nb::find(*this)); }

  // The activation bits of all layers but the last, and the outputs.
  nb::tuple trace(const Array& observation) const {
    const Activations activations = compute(observation);
    nb::list maps;
    for (size_t l = 0; l + 1 < packed_->shapes().size(); ++l)
      maps.append(unpacked(activations.maps[l], packed_->shapes()[l]));
    return nb::make_tuple(nb::tuple(maps), outputs(activations));
  }

 private:
  Network(const std::string& path, bool any_shape, std::unique_ptr<PackedNetwork> packed) : packed_(std::move(packed)) {
    const Path* const found = find_path(path.c_str());
    if (!found) throw nb::value_error(("this machine cannot run the path " + path).c_str());
    forward_ = packed_->is_paper() && !any_shape ? found->paper : found->any;
  }

  static PackedNetwork packed(const std::vector<Sizes>& layers, const std::vector<Signs>& weights,
                              const std::vector<Thresholds>& thresholds) {
    std::vector<LayerShape> shapes;
    for (const auto& [in_size, in_channels, kernel, stride, outputs] : layers) {
      const int out_size = stride > 0 ? (in_size - kernel) / stride + 1 : 0;
      shapes.push_back({in_size, in_channels, kernel, stride, out_size, outputs});
    }
    bool fits = is_chain(shapes) && weights.size() == shapes.size() && thresholds.size() + 1 == shapes.size();
    std::vector<SignMatrix> matrices;
    for (size_t l = 0; fits && l < shapes.size(); ++l) {
      const size_t outputs = shapes[l].outputs, inputs = fan_in(shapes[l]);
      const bool last = l + 1 == shapes.size();
      fits = weights[l].shape(0) == outputs && weights[l].shape(1) == inputs &&
             (last || thresholds[l].shape(0) == outputs);
      matrices.push_back({weights[l].data(), last ? nullptr : thresholds[l].data()});
    }
    if (!fits) throw nb::value_error("the weights and thresholds have shapes of no network");
    return PackedNetwork(shapes, matrices);
  }

  // What it returns is the thread's, until its next run.
  Activations compute(const Array& observation) const {
    const LayerShape& first = packed_->shapes().front();
    const size_t channels = first.in_channels, size = first.in_size;
    if (observation.dtype() != nb::dtype<uint8_t>() || observation.ndim() != 3 || observation.shape(0) != channels ||
        observation.shape(1) != size || observation.shape(2) != size) {
      const std::string px = std::to_string(size);
      throw nb::value_error(("observation is " + described(observation) + ", the network takes uint8[" +
                             std::to_string(channels) + ", " + px + ", " + px + "]")
                                .c_str());
    }
    const auto* pixels = static_cast<const uint8_t*>(observation.data());
    std::vector<uint8_t> copy;
    if (!is_contiguous(observation)) {
      copy = contiguous_copy(observation, pixels);
      pixels = copy.data();
    }
    nb::gil_scoped_release without_gil;
    static thread_local Memory scratch;
    if (scratch.size() < packed_->scratch_size()) scratch = Memory(packed_->scratch_size());
    const Activations out = packed_->activations(scratch.data());
    forward_(packed_->layers(), pixels, out);
    return out;
  }

  static bool is_contiguous(const Array& a) {
    const int64_t rows = a.shape(1), columns = a.shape(2);
    return a.stride(2) == 1 && a.stride(1) == columns && (a.stride(0) == rows * columns || a.shape(0) == 1);
  }

  static std::vector<uint8_t> contiguous_copy(const Array& a, const uint8_t* pixels) {
    std::vector<uint8_t> copy;
    copy.reserve(a.size());
    for (int64_t c = 0; c < int64_t(a.shape(0)); ++c)
      for (int64_t y = 0; y < int64_t(a.shape(1)); ++y)
        for (int64_t x = 0; x < int64_t(a.shape(2)); ++x)
          copy.push_back(pixels[c * a.stride(0) + y * a.stride(1) + x * a.stride(2)]);
    return copy;
  }

  Outputs outputs(const Activations& activations) const {
    const size_t count = packed_->shapes().back().outputs;
    std::unique_ptr<int32_t[]> o(new int32_t[count]);
    packed_->outputs(activations, o.get());
    return fresh_array<Outputs>(std::move(o), {count});
  }

  std::unique_ptr<PackedNetwork> packed_;
  Forward* forward_;
};

std::vector<std::string> available_paths() {
  std::vector<std::string> names;
  const PathList paths = compiled_paths();
  for (int i = 0; i < paths.count; ++i)
    if (paths.first[i].supported()) names.emplace_back(paths.first[i].name);
  return names;
}

}  // namespace
}  // namespace bpn

NB_MODULE(_native, module) {
  nb::set_leak_warnings(false);  // a kernel that is still held when the interpreter ends is no leak
  module.def("available_paths", &bpn::available_paths);
  nb::class_<bpn::Network>(module, "Network")
      .def(nb::init<const std::string&, bool, const std::vector<bpn::Sizes>&, const std::vector<bpn::Signs>&,
                    const std::vector<bpn::Thresholds>&>())
      .def("run", &bpn::Network::run)
      .def("read_back", &bpn::Network::read_back)
      .def("checksum", &bpn::Network::checksum)
      .def("memory", &bpn::Network::memory)
      .def("trace", &bpn::Network::trace);
}
