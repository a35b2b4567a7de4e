#include "packed_network.h"

#include <algorithm>
#include <cstring>

namespace bpn {

constexpr size_t kMapPadding = 8;
static constexpr size_t aligned(size_t size) { return (size + kAlignment - 1) / kAlignment * kAlignment; }

// Hands out aligned parts: of a memory, or (null) only their sizes.
class Parts {
 public:
  explicit Parts(unsigned char* memory) : memory_(memory) {}

  template <class Value>
  Value* take(size_t count) {
    const size_t at = size_;
    size_ += aligned(count * sizeof(Value));
    return memory_ ? reinterpret_cast<Value*>(memory_ + at) : nullptr;
  }
  size_t size() const { return size_; }

 private:
  unsigned char* memory_;
  size_t size_ = 0;
};

namespace {

size_t taps_of(const PixelLayer& layer) {
  return size_t(layer.shape.in_channels) * layer.shape.kernel * layer.groups * layer.blocks * kBlock;
}

Layers layers_in(const std::vector<LayerShape>& shapes, Parts& parts) {
  Layers layers{};
  layers.count = static_cast<int>(shapes.size());
  PixelLayer& first = layers.first;
  first.shape = shapes[0];
  first.blocks = ceil_div(first.shape.outputs, kBlock);
  first.groups = ceil_div(first.shape.kernel, kTapPixels);
  first.columns = ceil_div(first.shape.out_size, kMaxLanes) * kMaxLanes;
  first.taps = parts.take<uint32_t>(taps_of(first));
  first.floors = parts.take<int32_t>(first.blocks * kBlock);
  for (int l = 1; l < layers.count; ++l) {
    BitLayer& layer = layers.rest[l - 1];
    layer.shape = shapes[l];
    layer.blocks = ceil_div(layer.shape.outputs, kBlock);
    layer.in_bytes = ceil_div(layer.shape.in_channels, 8);
    layer.words = ceil_div(layer.shape.kernel * layer.shape.kernel * layer.in_bytes, 8);
    layer.weights = parts.take<WordBlock>(size_t(layer.blocks) * layer.words);
    layer.limits = l < layers.count - 1 ? parts.take<LimitBlock>(layer.blocks) : nullptr;
  }
  return layers;
}

// Calls f(index in a row of the matrix, tap, byte of it) for every pixel of a patch.
template <class F>
void each_pixel(const PixelLayer& layer, F&& f) {
  const int kernel = layer.shape.kernel, channels = layer.shape.in_channels;
  for (int r = 0, i = 0; r < kernel; ++r)
    for (int column = 0; column < kernel; ++column)
      for (int c = 0; c < channels; ++c, ++i)
        f(i, (c * kernel + r) * layer.groups + column / kTapPixels, column % kTapPixels);
}

// Calls f(index in a row of the matrix, word, bit of it) for every sign of a patch.
template <class F>
void each_bit(const BitLayer& layer, F&& f) {
  const int positions = layer.shape.kernel * layer.shape.kernel;
  for (int p = 0, i = 0; p < positions; ++p)
    for (int c = 0; c < layer.shape.in_channels; ++c, ++i) {
      const int bit = p * layer.in_bytes * 8 + c;
      f(i, bit / 64, bit % 64);
    }
}

void pack(const SignMatrix& matrix, const PixelLayer& layer) {
  const int inputs = fan_in(layer.shape), width = layer.blocks * kBlock;
  for (int k = 0; k < layer.shape.outputs; ++k)
    each_pixel(layer, [&](int i, int tap, int byte) {
      const uint32_t sign = static_cast<uint8_t>(matrix.signs[size_t(k) * inputs + i]);
      layer.taps[tap * width + k] |= sign << (8 * byte);
    });
  // o >= tau as o > tau - 1, with tau first brought next to the range of o: no overflow, same answer.
  const int32_t max_output = inputs * kMaxPixel;
  for (int k = 0; k < width; ++k)
    layer.floors[k] =
        k < layer.shape.outputs ? std::clamp(matrix.thresholds[k], -max_output, max_output + 1) - 1 : INT32_MAX;
}

// The largest d with fan_in - 2d >= tau; -1 (no d) to fan_in (every d).
int64_t difference_limit(int64_t fan_in, int64_t tau) {
  const int64_t slack = fan_in - tau;
  return slack < 0 ? -1 : std::min(slack / 2, fan_in);
}

void pack(const SignMatrix& matrix, const BitLayer& layer) {
  const int inputs = fan_in(layer.shape);
  for (int k = 0; k < layer.shape.outputs; ++k)
    each_bit(layer, [&](int i, int word, int bit) {
      if (matrix.signs[size_t(k) * inputs + i] > 0)
        layer.weights[k / kBlock * layer.words + word].lane[k % kBlock] |= uint64_t{1} << bit;
    });
  if (!layer.limits) return;
  for (int k = 0; k < layer.blocks * kBlock; ++k)
    layer.limits[k / kBlock].lane[k % kBlock] =
        k < layer.shape.outputs ? difference_limit(inputs, matrix.thresholds[k]) : -1;
}

void unpack(const PixelLayer& layer, const ReadBack& out) {
  const int inputs = fan_in(layer.shape), width = layer.blocks * kBlock;
  for (int k = 0; k < layer.shape.outputs; ++k) {
    each_pixel(layer, [&](int i, int tap, int byte) {
      out.signs[size_t(k) * inputs + i] = static_cast<int8_t>(layer.taps[tap * width + k] >> (8 * byte));
    });
    out.thresholds[k] = std::min(layer.floors[k], inputs * kMaxPixel) + 1;
  }
}

void unpack(const BitLayer& layer, const ReadBack& out) {
  const int inputs = fan_in(layer.shape);
  for (int k = 0; k < layer.shape.outputs; ++k) {
    each_bit(layer, [&](int i, int word, int bit) {
      const uint64_t bits = layer.weights[k / kBlock * layer.words + word].lane[k % kBlock];
      out.signs[size_t(k) * inputs + i] = bits >> bit & 1 ? 1 : -1;
    });
    if (!layer.limits) continue;
    const int64_t limit = layer.limits[k / kBlock].lane[k % kBlock];
    out.thresholds[k] = static_cast<int32_t>(inputs - 2 * std::clamp<int64_t>(limit, -1, inputs));
  }
}

bool same(const LayerShape& a, const LayerShape& b) {
  return a.in_size == b.in_size && a.kernel == b.kernel && a.stride == b.stride && a.out_size == b.out_size;
}

}  // namespace

Memory::Memory(size_t size)
    : data_(static_cast<unsigned char*>(::operator new(size, std::align_val_t{kAlignment}))), size_(size) {
  std::memset(data_.get(), 0, size);
}

void unpack_bits(const uint8_t* map, const LayerShape& shape, uint8_t* bits) {
  const int positions = shape.out_size * shape.out_size, bytes = ceil_div(shape.outputs, 8);
  for (int p = 0; p < positions; ++p, map += bytes)
    for (int k = 0; k < shape.outputs; ++k) *bits++ = map[k / 8] >> (k % 8) & 1;
}

bool is_chain(const std::vector<LayerShape>& shapes) {
  const int count = static_cast<int>(shapes.size());
  if (count < 2 || count > kMaxLayers) return false;
  int size = shapes[0].in_size, channels = shapes[0].in_channels;
  if (size < 1 || size > kMaxImagePx || channels < 1 || channels > kMaxChannels) return false;
  for (const LayerShape& shape : shapes) {
    const bool whole = shape.kernel == size;  // of any size, as its patch is not copied
    if (shape.in_size != size || shape.in_channels != channels || shape.kernel < 1 || shape.kernel > size ||
        (shape.kernel > kMaxKernel && (!whole || &shape == &shapes[0])) || shape.stride < 1 ||
        shape.out_size != (size - shape.kernel) / shape.stride + 1 || shape.outputs < 1 ||
        shape.outputs > (whole ? kMaxOutputs : kMaxConvolutionChannels))
      return false;
    size = shape.out_size, channels = shape.outputs;
  }
  return size == 1;
}

PackedNetwork::PackedNetwork(const std::vector<LayerShape>& shapes, const std::vector<SignMatrix>& matrices)
    : shapes_(shapes) {
  Parts sizes(nullptr);
  layers_in(shapes, sizes);
  memory_ = Memory(sizes.size());
  Parts parts(memory_.data());
  layers_ = layers_in(shapes, parts);
  pack(matrices[0], layers_.first);
  for (int l = 1; l < layers_.count; ++l) pack(matrices[l], layers_.rest[l - 1]);

  for (int l = 0; l < layers_.count - 1; ++l)
    map_bytes_.push_back(size_t(shapes[l].out_size) * shapes[l].out_size * ceil_div(shapes[l].outputs, 8));
  Parts scratch(nullptr);
  laid_out(scratch);
  scratch_size_ = scratch.size();
}

bool PackedNetwork::is_paper() const {
  constexpr int kPaperLayers = kPaperConvolutions + 2;
  if (layers_.count != kPaperLayers) return false;
  const LayerShape paper[kPaperLayers] = {
      {kImagePx, 0, kConv1Kernel, kConv1Stride, kConv1Size, kConv1Outputs},
      {kConv1Size, kConv1Outputs, kConv2Kernel, kConv2Stride, kConv2Size, kConv2Outputs},
      {kConv2Size, kConv2Outputs, kConv3Kernel, kConv3Stride, kConv3Size, kConv3Outputs},
      {kConv3Size, kConv3Outputs, kConv3Size, 1, 1, 0},
      {1, 0, 1, 1, 1, 0}};
  for (int l = 0; l < kPaperLayers; ++l)
    if (!same(shapes_[l], paper[l]) || (l < kPaperConvolutions && shapes_[l].outputs != paper[l].outputs)) return false;
  return true;
}

bool PackedNetwork::read_back(const std::vector<ReadBack>& matrices) const {
  unpack(layers_.first, matrices[0]);
  for (int l = 1; l < layers_.count; ++l) unpack(layers_.rest[l - 1], matrices[l]);
  std::vector<SignMatrix> read;
  for (const ReadBack& matrix : matrices) read.push_back({matrix.signs, matrix.thresholds});
  // What was read, packed again, is the memory: so nothing in it, padding included, was overlooked.
  const PackedNetwork again(shapes_, read);
  return std::memcmp(again.memory_.data(), memory_.data(), memory_.size()) == 0;
}

uint64_t PackedNetwork::checksum() const {
  uint64_t sum = 0xcbf29ce484222325;  // FNV-1a, by words: every step can be undone, so none loses a difference
  for (size_t i = 0; i < memory_.size(); i += sizeof(uint64_t)) {
    uint64_t word;
    std::memcpy(&word, memory_.data() + i, sizeof word);
    sum = (sum ^ word) * 0x100000001b3;
  }
  return sum;
}

Activations PackedNetwork::activations(unsigned char* scratch) const {
  Parts parts(scratch);
  const Activations out = laid_out(parts);
  for (size_t l = 0; l < map_bytes_.size(); ++l) std::memset(out.maps[l] + map_bytes_[l], 0, kMapPadding);
  return out;
}

void PackedNetwork::outputs(const Activations& activations, int32_t* o) const {
  const LayerShape& last = shapes_.back();
  for (int a = 0; a < last.outputs; ++a) o[a] = fan_in(last) - 2 * static_cast<int32_t>(activations.differences[a]);
}

Activations PackedNetwork::laid_out(Parts& parts) const {
  Activations out{};
  for (size_t l = 0; l < map_bytes_.size(); ++l) out.maps[l] = parts.take<uint8_t>(map_bytes_[l] + kMapPadding);
  out.differences = parts.take<int64_t>(size_t(layers_.rest[layers_.count - 2].blocks) * kBlock);
  const PixelLayer& first = layers_.first;
  const int rows = (kAnyRows - 1) * first.shape.stride + first.shape.kernel;
  out.band = parts.take<uint32_t>(size_t(first.shape.in_channels) * rows * first.groups * first.columns);
  return out;
}

}  // namespace bpn
