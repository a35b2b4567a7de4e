// Generated from bpn_shared/spec/network.py by `python -m checks.shapes`; change it there.
#pragma once

namespace bpn {

constexpr int kMaxLayers = 8;
constexpr int kMaxChannels = 16;
constexpr int kMinImagePx = 8;
constexpr int kMaxImagePx = 128;
constexpr int kMaxKernel = 16;
constexpr int kMaxConvolutionChannels = 128;
constexpr int kMaxOutputs = 1024;
constexpr int kMaxActions = 64;
constexpr int kMaxActionDims = 32;
constexpr int kMaxWeights = 4000000;
constexpr int kMaxMacs = 200000000;
constexpr int kMaxPixel = 255;

struct Convolution {
  int kernel, stride, outputs;
};
constexpr int kPaperImagePx = 84;
constexpr int kPaperConvolutions = 3;
constexpr Convolution kPaper[kPaperConvolutions] = {{8, 4, 8}, {4, 2, 16}, {3, 1, 16}};

}  // namespace bpn
