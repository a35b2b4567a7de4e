// The network's fixed sizes (paper, section V-A): Conv(8,4,8), Conv(4,2,16), Conv(3,1,16), FC(N), FC(|A|).
#pragma once

#include <cstdint>

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "bit maps are read as little-endian words");

namespace bpn {

constexpr int kImagePx = 84;
constexpr int kMaxChannels = 16;
constexpr int kMaxNodes = 1024;
constexpr int kMaxActions = 64;
constexpr int kMaxPixel = 255;

constexpr int kConv1Size = 20, kConv1Kernel = 8, kConv1Stride = 4, kConv1Outputs = 8;
constexpr int kConv2Size = 9, kConv2Kernel = 4, kConv2Stride = 2, kConv2Outputs = 16;
constexpr int kConv3Size = 7, kConv3Kernel = 3, kConv3Outputs = 16;
constexpr int kFeatures = kConv3Size * kConv3Size * kConv3Outputs;
constexpr int kLayers = 5;

// Outputs of layers 2-5 are computed eight at a time: one 64-bit word each in a 512-bit vector, and
// their eight activations are one byte.
constexpr int kBlock = 8;

static constexpr int ceil_div(int a, int b) { return (a + b - 1) / b; }
constexpr int kFeatureWords = ceil_div(kFeatures, 64);

// Four kernel columns of one channel are one 32-bit "tap": what one dot-product lane multiplies.
constexpr int kTapPixels = 4;
constexpr int kTapsPerRow = kConv1Kernel / kTapPixels;
constexpr int kTapsPerChannel = kConv1Kernel * kTapsPerRow;

}  // namespace bpn
