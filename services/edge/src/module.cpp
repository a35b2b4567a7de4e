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

#include "paths.h"

namespace nb = nanobind;

namespace bpn {
namespace {

using Array = nb::ndarray<nb::ro, nb::device::cpu>;
using Signs = nb::ndarray<const int8_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Thresholds = nb::ndarray<const int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Bits = nb::ndarray<nb::numpy, uint8_t, nb::ndim<1>>;
using Memory = nb::ndarray<nb::numpy, uint8_t, nb::ndim<1>>;
using Matrix = nb::ndarray<nb::numpy, int8_t, nb::ndim<2>>;
using Outputs = nb::ndarray<nb::numpy, int32_t, nb::ndim<1>>;

// A numpy array of its own.
template <class Result, class Value>
Result fresh_array(std::unique_ptr<Value[]> values, std::initializer_list<size_t> shape) {
  Value* data = values.release();
  return Result(data, shape, nb::capsule(data, [](void* p) noexcept { delete[] static_cast<Value*>(p); }));
}

Bits unpacked(const void* map, int count) {
  const auto* bytes = static_cast<const uint8_t*>(map);
  std::unique_ptr<uint8_t[]> bits(new uint8_t[count]);
  for (int i = 0; i < count; ++i) bits[i] = bytes[i / 8] >> (i % 8) & 1;
  return fresh_array<Bits>(std::move(bits), {size_t(count)});
}

std::string described(const Array& array) {
  std::string shape;
  for (size_t i = 0; i < array.ndim(); ++i) shape += (i ? ", " : "") + std::to_string(array.shape(i));
  const nb::dlpack::dtype dtype = array.dtype();
  const char* kinds[] = {"int", "uint", "float"};
  const std::string kind = dtype.code < 3 ? kinds[dtype.code] : "other";
  return kind + std::to_string(dtype.bits) + "[" + shape + "]";
}

class Network {
 public:
  Network(const std::string& path, int channels, const std::array<Signs, kLayers>& weights,
          const std::array<Thresholds, kLayers - 1>& thresholds)
      : forward_(find(path)),
        packed_(std::make_unique<PackedNetwork>()),
        channels_(channels),
        outputs_{kConv1Outputs, kConv2Outputs, kConv3Outputs, static_cast<int>(weights[3].shape(0)),
                 static_cast<int>(weights[4].shape(0))},
        fan_in_{kConv1Kernel * kConv1Kernel * channels, kConv2Kernel * kConv2Kernel * kConv1Outputs,
                kConv3Kernel * kConv3Kernel * kConv2Outputs, kFeatures, outputs_[3]} {
    const int nodes = outputs_[3], actions = outputs_[4];
    bool fits = channels >= 1 && channels <= kMaxChannels && nodes >= 1 && nodes <= kMaxNodes &&
                actions >= 1 && actions <= kMaxActions;
    SignMatrix layers[kLayers];
    for (int l = 0; l < kLayers; ++l) {
      const bool last = l == kLayers - 1;
      fits = fits && weights[l].shape(0) == size_t(outputs_[l]) && weights[l].shape(1) == size_t(fan_in_[l]) &&
             (last || thresholds[l].shape(0) == size_t(outputs_[l]));
      layers[l] = {weights[l].data(), last ? nullptr : thresholds[l].data(), outputs_[l], fan_in_[l]};
    }
    if (!fits) throw nb::value_error("the weights and thresholds have shapes of no network");
    pack_network(channels, layers, *packed_);
  }

  Outputs run(const Array& observation) const {
    Activations activations;
    compute(observation, activations);
    return outputs(activations);
  }

  // Every weight and threshold that is in the memory.
  nb::tuple read_back() const {
    std::unique_ptr<int8_t[]> signs[kLayers];
    std::unique_ptr<int32_t[]> thresholds[kLayers];
    ReadBack layers[kLayers];
    for (int l = 0; l < kLayers; ++l) {
      signs[l].reset(new int8_t[outputs_[l] * fan_in_[l]]);
      if (l < kLayers - 1) thresholds[l].reset(new int32_t[outputs_[l]]);
      layers[l] = {signs[l].get(), thresholds[l].get(), outputs_[l], fan_in_[l]};
    }
    if (!bpn::read_back(*packed_, channels_, layers))
      throw std::runtime_error("the memory holds bits that no packing makes");
    nb::list weights, taus;
    for (int l = 0; l < kLayers; ++l) {
      weights.append(fresh_array<Matrix>(std::move(signs[l]), {size_t(outputs_[l]), size_t(fan_in_[l])}));
      if (l < kLayers - 1) taus.append(fresh_array<Outputs>(std::move(thresholds[l]), {size_t(outputs_[l])}));
    }
    return nb::make_tuple(weights, taus);
  }

  uint64_t checksum() const { return bpn::checksum(*packed_); }

  // The memory itself, for tests that damage it.
  Memory memory() {
    return Memory(packed_.get(), {sizeof(PackedNetwork)}, nb::find(*this));
  }

  nb::tuple trace(const Array& observation) const {
    Activations a;
    compute(observation, a);
    return nb::make_tuple(unpacked(a.conv1, kConv1Size * kConv1Size * kConv1Outputs),
                          unpacked(a.conv2, kConv2Size * kConv2Size * kConv2Outputs),
                          unpacked(a.conv3, kFeatures), unpacked(a.fc1, packed_->fc1.outputs), outputs(a));
  }

 private:
  static Forward* find(const std::string& path) {
    const PathList paths = compiled_paths();
    for (int i = 0; i < paths.count; ++i)
      if (path == paths.first[i].name && paths.first[i].supported()) return paths.first[i].forward;
    throw nb::value_error(("this machine cannot run the path " + path).c_str());
  }

  void compute(const Array& observation, Activations& out) const {
    const size_t channels = packed_->conv1.channels;
    if (observation.dtype() != nb::dtype<uint8_t>() || observation.ndim() != 3 ||
        observation.shape(0) != channels || observation.shape(1) != kImagePx ||
        observation.shape(2) != kImagePx)
      throw nb::value_error(("observation is " + described(observation) + ", the network takes uint8[" +
                             std::to_string(channels) + ", 84, 84]").c_str());
    const auto* pixels = static_cast<const uint8_t*>(observation.data());
    std::vector<uint8_t> copy;
    if (!is_contiguous(observation)) {
      copy = contiguous_copy(observation, pixels);
      pixels = copy.data();
    }
    nb::gil_scoped_release without_gil;
    forward_(*packed_, pixels, out);
  }

  static bool is_contiguous(const Array& a) {
    return a.stride(2) == 1 && a.stride(1) == kImagePx &&
           (a.stride(0) == kImagePx * kImagePx || a.shape(0) == 1);
  }

  static std::vector<uint8_t> contiguous_copy(const Array& a, const uint8_t* pixels) {
    std::vector<uint8_t> copy;
    copy.reserve(a.size());
    for (int64_t c = 0; c < int64_t(a.shape(0)); ++c)
      for (int64_t y = 0; y < kImagePx; ++y)
        for (int64_t x = 0; x < kImagePx; ++x)
          copy.push_back(pixels[c * a.stride(0) + y * a.stride(1) + x * a.stride(2)]);
    return copy;
  }

  Outputs outputs(const Activations& activations) const {
    const int count = packed_->fc2.outputs;
    std::unique_ptr<int32_t[]> o(new int32_t[count]);
    for (int a = 0; a < count; ++a)
      o[a] = packed_->fc2.fan_in - 2 * static_cast<int32_t>(activations.differences[a]);
    return fresh_array<Outputs>(std::move(o), {size_t(count)});
  }

  Forward* forward_;
  std::unique_ptr<PackedNetwork> packed_;
  int channels_;
  int outputs_[kLayers];
  int fan_in_[kLayers];
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
      .def(nb::init<const std::string&, int, const std::array<bpn::Signs, bpn::kLayers>&,
                    const std::array<bpn::Thresholds, bpn::kLayers - 1>&>())
      .def("run", &bpn::Network::run)
      .def("read_back", &bpn::Network::read_back)
      .def("checksum", &bpn::Network::checksum)
      .def("memory", &bpn::Network::memory)
      .def("trace", &bpn::Network::trace);
}
