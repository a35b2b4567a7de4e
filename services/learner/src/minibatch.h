// What one minibatch reads, computes and leaves: plain pointers, so that every path can be compiled with
// its own instructions and nothing of it is shared with another.
#pragma once

#include <cstdint>

#include "geometry.h"

namespace bpn {

// Adds up numbers over all who share a minibatch, in place; null for one alone, whose sums are complete.
struct Exchange {
  void (*sum)(void* context, double* values, int count) = nullptr;
  void* context = nullptr;

  void operator()(double* values, int count) const {
    if (sum) sum(context, values, count);
  }
};

// A share of a minibatch, or all of it. Losses and gradients are this share's part of the minibatch's means.
struct Batch {
  int size;                      // images of this share, maybe 0
  const uint8_t* const* pixels;  // per image: [row][column][channel], readable kSlack bytes beyond its end
  const int64_t* taken;          // per image: the outputs of its action, one for each dimension
  int dimensions;
  const float* targets;
  int total;  // images of all shares
  Exchange exchange = {};
};
constexpr int kSlack = 64;

struct Parameters {
  const float *latent, *gamma, *beta;
  float log_scale;
};

struct Gradients {
  float *latent, *gamma, *beta;
  float log_scale, loss;
};

struct FloatParameters {
  const float *weights, *biases;
};

struct FloatGradients {
  float *weights, *biases;
  float loss;
};

// The part of a row of pixels, in bytes, that has all which are not 0; none is not 0 where begin = end.
struct Extent {
  int begin, end;
};

// Scratch. For layer l: weights (binarized: their signs) [width][fan_in]; inputs x_l [image][position][channel] from
// layer 2 on; outputs o_l (binarized: normalized by batch norm), and the gradient of o_l, both
// [image][position][width]; the gradient of the weights [width][rows][padded run].
struct Workspace {
  float* weights[kMaxLayers];
  float* inputs[kMaxLayers];
  float* outputs[kMaxLayers];
  float* gradients[kMaxLayers];
  float* weight_gradients[kMaxLayers];
  float* norm_scale[kMaxLayers];  // 1 / sqrt(var + epsilon), [width]
  float* gamma[kMaxLayers];       // padded with zeros
  float* beta[kMaxLayers];
  uint64_t* sign_bits[kMaxLayers];  // binarized: of the weights from layer 2 on, see `pack_signs`
  uint8_t* input_bits[kMaxLayers];  // binarized: of the inputs from layer 2 on, see `count_outputs`
  float* transposed[kMaxLayers];    // float: [fan_in][width] of the convolutions from the second on
  Extent* extents;                  // of the pixels, [image][row]
  int8_t* pixel_signs;              // conv1's, [eight outputs][row][eight inputs][output][input], zero beyond a row's
  float* pixel_weights;             // float: the same with as many inputs as fit a vector
  float* image;                     // float: one image, and zeros behind it
};

using Minibatch = void(const Geometry&, const Batch&, const Parameters&, const Workspace&, Gradients&);
using FloatMinibatch = void(const Geometry&, const Batch&, const FloatParameters&, const Workspace&, FloatGradients&);

struct Path {
  const char* name;
  bool (*supported)();  // by this processor and its operating system
  Minibatch* gradients;
  FloatMinibatch* float_gradients;
};

// All compiled paths, best first; the last one runs anywhere.
struct PathList {
  const Path* first;
  int count;
};
PathList compiled_paths();

Minibatch gradients_avx512_vnni;
Minibatch gradients_cascade_lake;
Minibatch gradients_avx2;
Minibatch gradients_portable;
FloatMinibatch float_gradients_avx512_vnni;
FloatMinibatch float_gradients_cascade_lake;
FloatMinibatch float_gradients_avx2;
FloatMinibatch float_gradients_portable;

}  // namespace bpn
