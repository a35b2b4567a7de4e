#include "blob.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "packed_network.h"
#include "sha256.h"

namespace bpn {
namespace {

constexpr size_t kMagic = 4, kHeader2 = 48, kHeader1 = 40, kDigest = 32;
constexpr int kMinLayers = 3, kMinActions = 2;

size_t aligned(size_t size) { return (size + kAlignment - 1) / kAlignment * kAlignment; }

[[noreturn]] void refuse(const std::string& reason) { throw BlobError(reason); }

void check_range(const std::string& what, int64_t value, int64_t least, int64_t most) {
  if (value < least || value > most)
    refuse(what + " is " + std::to_string(value) + ", not " + std::to_string(least) + " to " + std::to_string(most));
}

int u16(const uint8_t* at) { return at[0] | at[1] << 8; }

template <class Value>
Value loaded(const uint8_t* at) {
  Value value;
  std::memcpy(&value, at, sizeof value);
  return value;
}

void check_zeros(const char* where, const uint8_t* from, const uint8_t* end) {
  if (!std::all_of(from, end, [](uint8_t byte) { return byte == 0; })) refuse(std::string("a bit is not 0 ") + where);
}

void check_size(size_t size, size_t expected) {
  if (size != expected)
    refuse("it has " + std::to_string(size) + " bytes, a blob of this network " + std::to_string(expected));
}

size_t row_bytes(const LayerShape& shape) { return size_t(ceil_div(fan_in(shape), 32)) * 4; }

// The layers, each on the one before it, from k, d and m of each.
class Chain {
 public:
  Chain(int channels, int image_px) : size_(image_px), channels_(channels) {
    check_range("C", channels, 1, kMaxChannels);
    check_range("P", image_px, kMinImagePx, kMaxImagePx);
  }

  void convolution(int kernel, int stride, int outputs) {
    const std::string layer = "layer " + std::to_string(shapes_.size() + 1);
    check_range(layer + ": k", kernel, 1, std::min(kMaxKernel, size_));
    check_range(layer + ": d", stride, 1, kernel);
    check_range(layer + ": m", outputs, 1, kMaxConvolutionChannels);
    add(kernel, stride, outputs);
  }

  void connected(const char* name, int kernel, int stride, int outputs, int least, int most) {
    if (kernel != size_ || stride != 1) refuse(std::string(name) + " does not cover its input at one position");
    check_range(std::string(name) + "'s outputs", outputs, least, most);
    add(kernel, stride, outputs);
  }

  const std::vector<LayerShape>& checked() const {
    int64_t signs = 0, products = 0;
    for (const LayerShape& shape : shapes_) {
      const int64_t own = int64_t{shape.outputs} * fan_in(shape);
      signs += own, products += own * shape.out_size * shape.out_size;
    }
    check_range("its number of signs", signs, 1, kMaxWeights);
    check_range("its number of products", products, 1, kMaxMacs);
    return shapes_;
  }

 private:
  void add(int kernel, int stride, int outputs) {
    const int out_size = (size_ - kernel) / stride + 1;
    shapes_.push_back({size_, channels_, kernel, stride, out_size, outputs});
    size_ = out_size, channels_ = outputs;
  }

  std::vector<LayerShape> shapes_;
  int size_, channels_;
};

// What both schemas have behind each other: run, attempt, version, lambda.
void take_provenance(const uint8_t* at, Blob& blob) {
  std::copy_n(at, blob.run.size(), blob.run.begin());
  blob.attempt = loaded<uint32_t>(at + 16), blob.version = loaded<uint32_t>(at + 20);
  blob.scale = loaded<float>(at + 24);
  if (!std::isfinite(blob.scale) || !(blob.scale > 0)) refuse("lambda is not finite and above 0");
}

int8_t sign(const uint8_t* bits, size_t at) { return bits[at / 8] >> (at % 8) & 1 ? 1 : -1; }

std::vector<int32_t> taken_thresholds(const uint8_t* at, int count) {
  std::vector<int32_t> thresholds(count);
  std::memcpy(thresholds.data(), at, sizeof(int32_t) * count);
  return thresholds;
}

Blob decode_2(const uint8_t* data, size_t size) {
  if (size < kHeader2 + kDigest) refuse("its header is cut off");
  const int count = u16(data + 10), dimensions = u16(data + 12);
  Chain chain(u16(data + 6), u16(data + 8));
  check_range("L", count, kMinLayers, kMaxLayers);
  check_range("D", dimensions, 1, kMaxActionDims);
  const uint8_t *rows = data + kHeader2, *choices = rows + 8 * count, *end = choices + 2 * dimensions;
  const size_t header = aligned(end - data);
  if (size < header + kDigest) refuse("its header is cut off");
  Blob blob{};
  blob.schema = 2;
  take_provenance(data + 16, blob);
  for (int l = 0; l < count; ++l, rows += 8) {
    const int kernel = u16(rows), stride = u16(rows + 2), outputs = u16(rows + 4);
    if (l < count - 2)
      chain.convolution(kernel, stride, outputs);
    else if (l < count - 1)
      chain.connected("FC(N)", kernel, stride, outputs, 1, kMaxOutputs);
    else
      chain.connected("FC(|A|)", kernel, stride, outputs, kMinActions, kMaxActions);
    check_zeros("in a layer's row of the header", rows + 6, rows + 8);
  }
  blob.shapes = chain.checked();
  int together = 0;
  for (int i = 0; i < dimensions; ++i) {
    blob.choices.push_back(u16(choices + 2 * i));
    check_range("a dimension's number of choices", blob.choices.back(), kMinActions, kMaxActions);
    together += blob.choices.back();
  }
  if (together != blob.shapes.back().outputs)
    refuse("the dimensions have " + std::to_string(together) + " choices, FC(|A|) has " +
           std::to_string(blob.shapes.back().outputs) + " outputs");
  check_zeros("in the header", data + 14, data + 16);
  check_zeros("in the header", data + 44, data + kHeader2);
  check_zeros("behind the choices", end, data + header);

  size_t expected = header + kDigest;
  for (const LayerShape& shape : blob.shapes) {
    expected += aligned(row_bytes(shape) * shape.outputs);
    if (&shape != &blob.shapes.back()) expected += aligned(sizeof(int32_t) * shape.outputs);
  }
  check_size(size, expected);
  const uint8_t* at = data + header;
  const auto section = [&](size_t bytes) {
    const uint8_t* from = at;
    at += aligned(bytes);
    check_zeros("behind a section", from + bytes, at);
    return from;
  };
  for (const LayerShape& shape : blob.shapes) {
    const size_t inputs = fan_in(shape), bytes = row_bytes(shape);
    const uint8_t* row = section(bytes * shape.outputs);
    std::vector<int8_t>& signs = blob.signs.emplace_back();
    signs.reserve(inputs * shape.outputs);
    for (int j = 0; j < shape.outputs; ++j, row += bytes) {
      for (size_t i = 0; i < inputs; ++i) signs.push_back(sign(row, i));
      for (size_t i = inputs; i < 8 * bytes; ++i)
        if (sign(row, i) > 0) refuse("a bit is not 0 behind a row of signs");
    }
  }
  for (int l = 0; l < count - 1; ++l) {
    const int outputs = blob.shapes[l].outputs;
    blob.thresholds.push_back(taken_thresholds(section(sizeof(int32_t) * outputs), outputs));
  }
  return blob;
}

Blob decode_1(const uint8_t* data, size_t size) {
  if (size < kHeader1 + kDigest) refuse("its header is cut off");
  Chain chain(u16(data + 6), kPaperImagePx);
  for (const Convolution& own : kPaper) chain.convolution(own.kernel, own.stride, own.outputs);
  const int actions = u16(data + 10);
  chain.connected("FC(N)", kConv3Size, 1, u16(data + 8), 1, kMaxOutputs);
  chain.connected("FC(|A|)", 1, 1, actions, kMinActions, kMaxActions);
  Blob blob{};
  blob.schema = 1;
  take_provenance(data + 12, blob);
  blob.shapes = chain.checked();
  blob.choices = {actions};
  size_t expected = kHeader1 + kDigest;
  for (const LayerShape& shape : blob.shapes) {
    expected += (size_t(shape.outputs) * fan_in(shape) + 7) / 8;
    if (&shape != &blob.shapes.back()) expected += sizeof(int32_t) * shape.outputs;
  }
  check_size(size, expected);
  const uint8_t* at = data + kHeader1;
  for (const LayerShape& shape : blob.shapes) {
    const size_t count = size_t(shape.outputs) * fan_in(shape), bytes = (count + 7) / 8;
    std::vector<int8_t>& signs = blob.signs.emplace_back();
    signs.reserve(count);
    for (size_t i = 0; i < count; ++i) signs.push_back(sign(at, i));
    for (size_t i = count; i < 8 * bytes; ++i)
      if (sign(at, i) > 0) refuse("a bit is not 0 behind a layer's signs");
    at += bytes;
  }
  for (size_t l = 0; l + 1 < blob.shapes.size(); at += sizeof(int32_t) * blob.shapes[l].outputs, ++l)
    blob.thresholds.push_back(taken_thresholds(at, blob.shapes[l].outputs));
  return blob;
}

}  // namespace

Blob decode(const uint8_t* data, size_t size) {
  if (size < kMagic + 2 + kDigest || std::memcmp(data, "BPNW", kMagic) != 0) refuse("it is no weight blob");
  const int schema = u16(data + kMagic);
  if (schema != 1 && schema != 2) refuse("its schema is " + std::to_string(schema) + ", read are 1 and 2");
  const Digest digest = sha256(data, size - kDigest);
  if (!std::equal(digest.begin(), digest.end(), data + size - kDigest))
    refuse("its SHA-256 is another: it was cut off or altered");
  return schema == 1 ? decode_1(data, size) : decode_2(data, size);
}

}  // namespace bpn
