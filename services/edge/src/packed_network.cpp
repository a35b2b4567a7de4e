#include "packed_network.h"

#include <algorithm>

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

}  // namespace

void pack_network(int channels, const SignMatrix (&layers)[kLayers], PackedNetwork& out) {
  pack_pixel_layer(channels, layers[0], out.conv1);
  pack_bit_layer(layers[1], 64, out.conv2);
  pack_bit_layer(layers[2], kConv3Kernel * kConv2Outputs, out.conv3);
  pack_bit_layer(layers[3], 64, out.fc1);
  pack_bit_layer(layers[4], 64, out.fc2);
}

}  // namespace bpn
