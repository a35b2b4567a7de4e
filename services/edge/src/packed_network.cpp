#include "packed_network.h"

#include <algorithm>
#include <cstring>
#include <memory>

namespace bpn {
namespace {

void pack_pixel_layer(int channels, const SignMatrix& matrix, PixelLayer& layer) {
  layer.channels = channels;
  for (int c = 0; c < channels; ++c)
    for (int tap = 0; tap < kTapsPerChannel; ++tap)
      for (int k = 0; k < kConv1Outputs; ++k)
        for (int j = 0; j < kTapPixels; ++j) {
          // (kernel row, kernel column) = (tap / 2, tap % 2 * 4 + j), flattened.
          const int pixel = tap * kTapPixels + j;
          const int8_t sign = matrix.signs[k * matrix.fan_in + pixel * channels + c];
          layer.taps[c * kTapsPerChannel + tap][k] |= uint32_t{static_cast<uint8_t>(sign)} << (8 * j);
        }
  // o >= tau as o > tau - 1, with tau first brought next to the range of o: no overflow, same answer.
  const int32_t max_output = matrix.fan_in * kMaxPixel;
  for (int k = 0; k < kConv1Outputs; ++k)
    layer.floors[k] = std::clamp(matrix.thresholds[k], -max_output, max_output + 1) - 1;
}

// The largest d with fan_in - 2d >= tau; -1 (no d) to fan_in (every d).
int64_t difference_limit(int64_t fan_in, int64_t tau) {
  const int64_t slack = fan_in - tau;
  return slack < 0 ? -1 : std::min(slack / 2, fan_in);
}

template <int MaxOutputs, int MaxWords>
void pack_bit_layer(const SignMatrix& matrix, int bits_per_word, BitLayer<MaxOutputs, MaxWords>& layer) {
  layer.outputs = matrix.outputs;
  layer.fan_in = matrix.fan_in;
  layer.blocks = ceil_div(matrix.outputs, kBlock);
  layer.words = ceil_div(matrix.fan_in, bits_per_word);
  for (int k = 0; k < matrix.outputs; ++k)
    for (int i = 0; i < matrix.fan_in; ++i)
      if (matrix.signs[k * matrix.fan_in + i] > 0)
        layer.weights[k / kBlock][i / bits_per_word].lane[k % kBlock] |= uint64_t{1}
                                                                        << (i % bits_per_word);
  if (matrix.thresholds == nullptr) return;
  for (int k = 0; k < layer.blocks * kBlock; ++k)
    layer.limits[k / kBlock].lane[k % kBlock] =
        k < matrix.outputs ? difference_limit(matrix.fan_in, matrix.thresholds[k]) : -1;
}

void unpack_pixel_layer(int channels, const PixelLayer& layer, const ReadBack& out) {
  for (int c = 0; c < channels; ++c)
    for (int tap = 0; tap < kTapsPerChannel; ++tap)
      for (int k = 0; k < kConv1Outputs; ++k)
        for (int j = 0; j < kTapPixels; ++j) {
          const int pixel = tap * kTapPixels + j;
          out.signs[k * out.fan_in + pixel * channels + c] =
              static_cast<int8_t>(layer.taps[c * kTapsPerChannel + tap][k] >> (8 * j));
        }
  for (int k = 0; k < kConv1Outputs; ++k)
    out.thresholds[k] = std::min(layer.floors[k], out.fan_in * kMaxPixel) + 1;
}

template <int MaxOutputs, int MaxWords>
void unpack_bit_layer(const BitLayer<MaxOutputs, MaxWords>& layer, int bits_per_word, const ReadBack& out) {
  for (int k = 0; k < out.outputs; ++k)
    for (int i = 0; i < out.fan_in; ++i) {
      const uint64_t word = layer.weights[k / kBlock][i / bits_per_word].lane[k % kBlock];
      out.signs[k * out.fan_in + i] = word >> (i % bits_per_word) & 1 ? 1 : -1;
    }
  if (out.thresholds == nullptr) return;
  for (int k = 0; k < out.outputs; ++k) {
    const int64_t limit = layer.limits[k / kBlock].lane[k % kBlock];
    out.thresholds[k] =
        static_cast<int32_t>(out.fan_in - 2 * std::clamp<int64_t>(limit, -1, out.fan_in));
  }
}

}  // namespace

bool read_back(const PackedNetwork& packed, int channels, const ReadBack (&layers)[kLayers]) {
  unpack_pixel_layer(channels, packed.conv1, layers[0]);
  unpack_bit_layer(packed.conv2, 64, layers[1]);
  unpack_bit_layer(packed.conv3, kConv3Kernel * kConv2Outputs, layers[2]);
  unpack_bit_layer(packed.fc1, 64, layers[3]);
  unpack_bit_layer(packed.fc2, 64, layers[4]);
  SignMatrix matrices[kLayers];
  for (int l = 0; l < kLayers; ++l)
    matrices[l] = {layers[l].signs, layers[l].thresholds, layers[l].outputs, layers[l].fan_in};
  // What was read, packed again, is the memory: so nothing in it, padding and sizes included, was overlooked.
  const auto again = std::make_unique<PackedNetwork>();
  pack_network(channels, matrices, *again);
  return std::memcmp(again.get(), &packed, sizeof packed) == 0;
}

uint64_t checksum(const PackedNetwork& packed) {
  static_assert(sizeof packed % sizeof(uint64_t) == 0);
  const auto* bytes = reinterpret_cast<const unsigned char*>(&packed);
  uint64_t sum = 0xcbf29ce484222325;  // FNV-1a, by words: every step can be undone, so none loses a difference
  for (size_t i = 0; i < sizeof packed; i += sizeof(uint64_t)) {
    uint64_t word;
    std::memcpy(&word, bytes + i, sizeof word);
    sum = (sum ^ word) * 0x100000001b3;
  }
  return sum;
}

void pack_network(int channels, const SignMatrix (&layers)[kLayers], PackedNetwork& out) {
  pack_pixel_layer(channels, layers[0], out.conv1);
  pack_bit_layer(layers[1], 64, out.conv2);
  pack_bit_layer(layers[2], kConv3Kernel * kConv2Outputs, out.conv3);
  pack_bit_layer(layers[3], 64, out.fc1);
  pack_bit_layer(layers[4], 64, out.fc2);
}

}  // namespace bpn
