// The Python side of the minibatch kernel: bpn_learner._native.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <vector>

#include "minibatch.h"

namespace nb = nanobind;

namespace bpn {
namespace {

template <class Value, int Dimensions>
using Array = nb::ndarray<Value, nb::ndim<Dimensions>, nb::c_contig, nb::device::cpu>;

constexpr size_t kAlignment = 64;

struct Free {
  void operator()(void* memory) const { ::operator delete(memory, std::align_val_t{kAlignment}); }
};

// Zeroed memory at a cache line's start, wherever the process's other memory lies.
class Arena {
 public:
  float* floats(size_t count) { return static_cast<float*>(bytes(count * sizeof(float))); }
  void* bytes(size_t count) {
    blocks_.emplace_back(::operator new(count, std::align_val_t{kAlignment}));
    return std::memset(blocks_.back().get(), 0, count);
  }

 private:
  std::vector<std::unique_ptr<void, Free>> blocks_;
};

const Path& find(const std::string& path) {
  const PathList paths = compiled_paths();
  for (int i = 0; i < paths.count; ++i)
    if (path == paths.first[i].name && paths.first[i].supported()) return paths.first[i];
  throw nb::value_error(("this machine cannot run the path " + path).c_str());
}

using Sizes = std::array<int, 5>;  // in_size, in_channels, kernel, stride, outputs

Geometry geometry_of(const std::vector<Sizes>& layers) {
  std::vector<LayerShape> shapes;
  for (const auto& [in_size, in_channels, kernel, stride, outputs] : layers)
    shapes.push_back({in_size, in_channels, kernel, stride, outputs});
  const int count = static_cast<int>(shapes.size());
  if (!Geometry::is_chain(shapes.data(), count)) throw nb::value_error("the layers are those of no network");
  return Geometry(shapes.data(), count);
}

// What both kinds of network need: the geometry's scratch, and the minibatch as pointers into D.
class Scratch {
 public:
  Scratch(const std::string& path, const std::vector<Sizes>& layers)
      : path_(find(path)), geometry_(geometry_of(layers)) {
    for (int l = 0; l < geometry_.count; ++l) {
      const Layer& layer = geometry_.layers[l];
      weights_ += size_t(layer.outputs) * layer.true_fan_in();
      if (l < geometry_.norms()) norms_ += layer.outputs;
      biases_ += layer.outputs;
      work_.weights[l] = fixed_.floats(size_t(layer.width) * layer.fan_in());
      work_.weight_gradients[l] = fixed_.floats(size_t(layer.width) * layer.rows * padded(layer.run));
    }
    padded_image_ = static_cast<uint8_t*>(fixed_.bytes(size_t(geometry_.layers[0].image) + kSlack));
  }

  Scratch(const Scratch&) = delete;

 protected:
  // Checks a share of a minibatch of `total` and finds its images. It is valid until the next call.
  Batch take(const Array<const uint8_t, 4>& observations, const Array<const int64_t, 1>& batch,
             const Array<const int64_t, 2>& actions, const Array<const float, 1>& targets, int total,
             Exchange exchange = {}) {
    const Layer& conv1 = geometry_.layers[0];
    const size_t n = observations.shape(0), B = batch.shape(0);
    const size_t size = conv1.row_stride / conv1.in_channels, channels = conv1.in_channels;
    if (observations.shape(1) != size || observations.shape(2) != size || observations.shape(3) != channels) {
      const std::string px = std::to_string(size);
      throw nb::value_error(("observations have not the network's shape uint8[n, " + px + ", " + px + ", " +
                             std::to_string(channels) + "]")
                                .c_str());
    }
    if (actions.shape(0) != n || targets.shape(0) != n)
      throw nb::value_error("observations, actions and targets have different lengths");
    const size_t D = actions.shape(1);
    if (D < 1) throw nb::value_error("an action needs at least 1 output");
    if (total < 1 || size_t(total) < B) throw nb::value_error("a minibatch needs at least 1 transition");
    images_.resize(B), actions_.resize(B * D), targets_.resize(B);
    for (size_t b = 0; b < B; ++b) {
      const int64_t i = batch.data()[b];
      if (i < 0 || size_t(i) >= n) throw nb::index_error("the minibatch names a transition outside D");
      for (size_t d = 0; d < D; ++d) {
        const int64_t output = actions_[b * D + d] = actions.data()[size_t(i) * D + d];
        if (output < 0 || output >= geometry_.layers[geometry_.count - 1].outputs)
          throw nb::index_error("an action is outside the network's");
      }
      images_[b] = observations.data() + size_t(i) * conv1.image;
      targets_[b] = targets.data()[i];
      if (size_t(i) == n - 1)  // nothing may be read behind the last one
        images_[b] = static_cast<uint8_t*>(std::memcpy(padded_image_, images_[b], conv1.image));
    }
    reserve(std::max(B, size_t(1)));
    return {int(B), images_.data(), actions_.data(), int(D), targets_.data(), total, exchange};
  }

  // Values of conv1's weights where up to eight inputs of a row lie together.
  static size_t together_size(const Layer& conv1) {
    return size_t(padded(conv1.width)) * conv1.rows * (conv1.run + kTogetherPixels);
  }

  static void check_sizes(bool fit) {
    if (!fit) throw nb::value_error("parameters or gradients have not the network's sizes");
  }

  const Path& path_;
  Geometry geometry_;
  Arena fixed_, images_memory_;
  Workspace work_{};
  size_t weights_ = 0, norms_ = 0, biases_ = 0, capacity_ = 0;

 private:
  void reserve(size_t B) {
    if (B <= capacity_) return;
    capacity_ = B;
    images_memory_ = Arena();
    work_.extents = static_cast<Extent*>(images_memory_.bytes(B * geometry_.layers[0].in_rows() * sizeof(Extent)));
    for (int l = 0; l < geometry_.count; ++l) {
      const Layer& layer = geometry_.layers[l];
      const size_t values = B * layer.positions() * layer.width;
      work_.outputs[l] = images_memory_.floats(values);
      work_.gradients[l] = images_memory_.floats(values);
      if (l == 0) continue;
      work_.inputs[l] = images_memory_.floats(B * layer.image);
      work_.input_bits[l] = static_cast<uint8_t*>(images_memory_.bytes(B * layer.bit_bytes() + sizeof(uint64_t)));
    }
  }

  uint8_t* padded_image_;
  std::vector<const uint8_t*> images_;
  std::vector<int64_t> actions_;
  std::vector<float> targets_;
};

// Has a Python function add up numbers; without one, nobody shares the minibatch.
class PythonExchange {
 public:
  explicit PythonExchange(const std::optional<nb::callable>& function) : function_(function) {}

  Exchange exchange() { return function_ ? Exchange{&PythonExchange::sum, this} : Exchange{}; }

 private:
  static void sum(void* self, double* values, int count) {
    nb::gil_scoped_acquire with_gil;
    const size_t shape[] = {size_t(count)};
    const nb::ndarray<nb::numpy, double> sums(values, 1, shape, nb::handle());
    (*static_cast<PythonExchange*>(self)->function_)(nb::cast(sums, nb::rv_policy::reference));
  }

  const std::optional<nb::callable>& function_;
};

class Kernel : Scratch {
 public:
  Kernel(const std::string& path, const std::vector<Sizes>& layers) : Scratch(path, layers) {
    for (int l = 0; l < geometry_.norms(); ++l) {
      const int width = geometry_.layers[l].width;
      work_.norm_scale[l] = fixed_.floats(width);
      work_.gamma[l] = fixed_.floats(width);
      work_.beta[l] = fixed_.floats(width);
    }
    for (int l = 1; l < geometry_.count; ++l) {
      const Layer& layer = geometry_.layers[l];
      work_.sign_bits[l] = static_cast<uint64_t*>(fixed_.bytes(size_t(layer.width) * layer.patch_words() * 8));
    }
    const Layer& conv1 = geometry_.layers[0];
    work_.pixel_signs = static_cast<int8_t*>(fixed_.bytes(together_size(conv1)));
  }

  nb::tuple gradients(const Array<const uint8_t, 4>& observations, const Array<const int64_t, 1>& batch,
                      const Array<const int64_t, 2>& actions, const Array<const float, 1>& targets,
                      const Array<const float, 1>& latent, const Array<const float, 1>& gamma,
                      const Array<const float, 1>& beta, float log_scale, const Array<float, 1>& d_latent,
                      const Array<float, 1>& d_gamma, const Array<float, 1>& d_beta, int total,
                      const std::optional<nb::callable>& sum) {
    check_sizes(latent.shape(0) == weights_ && d_latent.shape(0) == weights_ && gamma.shape(0) == norms_ &&
                beta.shape(0) == norms_ && d_gamma.shape(0) == norms_ && d_beta.shape(0) == norms_);
    PythonExchange others(sum);
    const Batch taken = take(observations, batch, actions, targets, total, others.exchange());
    Gradients out{d_latent.data(), d_gamma.data(), d_beta.data(), 0, 0};
    {
      nb::gil_scoped_release without_gil;
      path_.gradients(geometry_, taken, {latent.data(), gamma.data(), beta.data(), log_scale}, work_, out);
    }
    return nb::make_tuple(out.loss, out.log_scale);
  }
};

class FloatKernel : Scratch {
 public:
  FloatKernel(const std::string& path, const std::vector<Sizes>& layers) : Scratch(path, layers) {
    const Layer& conv1 = geometry_.layers[0];
    for (int l = 1; l < geometry_.count; ++l) {
      const Layer& layer = geometry_.layers[l];
      work_.transposed[l] = layer.connected ? nullptr : fixed_.floats(size_t(layer.width) * layer.fan_in());
    }
    work_.pixel_weights = fixed_.floats(together_size(conv1));
    work_.image = fixed_.floats(size_t(conv1.image) + kBlock);
  }

  float gradients(const Array<const uint8_t, 4>& observations, const Array<const int64_t, 1>& batch,
                  const Array<const int64_t, 2>& actions, const Array<const float, 1>& targets,
                  const Array<const float, 1>& weights, const Array<const float, 1>& biases,
                  const Array<float, 1>& d_weights, const Array<float, 1>& d_biases, int total) {
    check_sizes(weights.shape(0) == weights_ && d_weights.shape(0) == weights_ && biases.shape(0) == biases_ &&
                d_biases.shape(0) == biases_);
    const Batch taken = take(observations, batch, actions, targets, total);
    FloatGradients out{d_weights.data(), d_biases.data(), 0};
    nb::gil_scoped_release without_gil;
    path_.float_gradients(geometry_, taken, {weights.data(), biases.data()}, work_, out);
    return out.loss;
  }
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
  nb::class_<bpn::Kernel>(module, "Kernel")
      .def(nb::init<const std::string&, const std::vector<bpn::Sizes>&>())
      .def("gradients", &bpn::Kernel::gradients);
  nb::class_<bpn::FloatKernel>(module, "FloatKernel")
      .def(nb::init<const std::string&, const std::vector<bpn::Sizes>&>())
      .def("gradients", &bpn::FloatKernel::gradients);
}
