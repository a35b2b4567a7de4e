// Sizes that the code for the paper's shape (section V-A) is written for, and units of the packed layout.
#pragma once

#include <cstdint>

#include "shapes.h"

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "bit maps are read as little-endian words");

namespace bpn {

static constexpr int ceil_div(int a, int b) { return (a + b - 1) / b; }

constexpr int kImagePx = kPaperImagePx;
constexpr int kConv1Kernel = kPaper[0].kernel, kConv1Stride = kPaper[0].stride, kConv1Outputs = kPaper[0].outputs;
constexpr int kConv2Kernel = kPaper[1].kernel, kConv2Stride = kPaper[1].stride, kConv2Outputs = kPaper[1].outputs;
constexpr int kConv3Kernel = kPaper[2].kernel, kConv3Stride = kPaper[2].stride, kConv3Outputs = kPaper[2].outputs;
constexpr int kConv1Size = (kImagePx - kConv1Kernel) / kConv1Stride + 1;
constexpr int kConv2Size = (kConv1Size - kConv2Kernel) / kConv2Stride + 1;
constexpr int kConv3Size = (kConv2Size - kConv3Kernel) / kConv3Stride + 1;
constexpr int kFeatureWords = ceil_div(kConv3Size * kConv3Size * kConv3Outputs, 64);

// Outputs are computed eight at a time: of layers from 2 on one 64-bit word each in a 512-bit vector, and their
// eight activations are one byte.
constexpr int kBlock = 8;

// Four kernel columns of one channel are one 32-bit "tap": what one dot-product lane multiplies.
constexpr int kTapPixels = 4;
constexpr int kTapsPerRow = kConv1Kernel / kTapPixels;
constexpr int kTapsPerChannel = kConv1Kernel * kTapsPerRow;

// The code for any shape (any_shape.h) does so many output rows together, so that a sign is loaded once for all of
// them, and whole vectors of positions: as many as the widest machine has lanes.
constexpr int kAnyRows = 4;
constexpr int kMaxLanes = 16;
constexpr int kMaxPatchWords = kMaxKernel * kMaxKernel * kMaxConvolutionChannels / 64;

}  // namespace bpn
