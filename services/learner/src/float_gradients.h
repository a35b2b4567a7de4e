// One minibatch of a float network (biases, ReLU): forward pass, loss and all gradients. Compiled once for
// each path.
#pragma once

#include "float_pixels.h"
#include "layers.h"

namespace bpn {
namespace {

// Outputs of layer l >= 1 from its inputs.
inline void layer_outputs(const Geometry& geometry, int B, const Workspace& work, int l) {
  const Layer& layer = geometry.layers[l];
  if (!layer.connected)
    convolve(layer, B, work.inputs[l], work.transposed[l], work.outputs[l]);
  else
    connect(layer, B, work.inputs[l], work.weights[l], work.outputs[l]);
}

// The weights in the layouts that the products read. Padding stays zero.
inline void take_weights(const Geometry& geometry, const float* from, const Workspace& work) {
  for (int l = 0; l < geometry.count; ++l) {
    const Layer& layer = geometry.layers[l];
    const int fan_in = layer.fan_in();
    for (int n = 0; n < layer.outputs; ++n, from += layer.true_fan_in()) {
      float* weights = work.weights[l] + n * fan_in;
      // conv1's weights are divided by the largest pixel in place of the pixels
      each_input(layer, [&](int k, int to) { weights[to] = l == 0 ? from[k] / kMaxPixel : from[k]; });
      if (work.transposed[l])
        for (int k = 0; k < fan_in; ++k) work.transposed[l][k * layer.width + n] = weights[k];
      if (l == 0)
        for (int k = 0; k < fan_in; ++k) work.pixel_weights[together_at<kTogether>(layer, n, k)] = weights[k];
    }
  }
}

// x = max(o + bias, 0), o [n][width]; padding of the width gives 0.
inline void rectify(int n, const Layer& l, const float* o, const float* biases, float* x) {
  float bias[kMaxOutputs] = {};
  std::memcpy(bias, biases, sizeof(float) * l.outputs);
  for (int i = 0; i < n; ++i, o += l.width, x += l.width)
    for (int c = 0; c < l.width; ++c) {
      const float z = o[c] + bias[c];
      x[c] = z > 0 ? z : 0;
    }
}

// g, the gradient of x, becomes that of o; its sums over n are the biases'.
inline void rectify_back(int n, const Layer& l, const float* x, float* g, float* d_biases) {
  float sums[kMaxOutputs] = {};
  for (int i = 0; i < n; ++i, g += l.width, x += l.width)
    for (int c = 0; c < l.width; ++c) {
      g[c] = x[c] > 0 ? g[c] : 0;
      sums[c] += g[c];
    }
  std::memcpy(d_biases, sums, sizeof(float) * l.outputs);
}

inline void float_gradients(const Geometry& geometry, const Batch& batch, const FloatParameters& in,
                            const Workspace& work, FloatGradients& out) {
  const Layer* layers = geometry.layers;
  const int B = batch.size, last = geometry.count - 1;
  take_weights(geometry, in.weights, work);

  const Layer& conv1 = layers[0];
  for (int b = 0; b < B; ++b) {
    Extent* const extents = work.extents + b * conv1.in_rows();
    take_extents(conv1, batch.pixels[b], extents);
    for (int k = 0; k < conv1.image; ++k) work.image[k] = batch.pixels[b][k];
    convolve_floats(conv1, work.image, extents, work.pixel_weights,
                    work.outputs[0] + b * conv1.positions() * conv1.width);
  }
  int first = 0;  // of the layer's biases
  for (int l = 0; l < last; first += layers[l].outputs, ++l) {
    rectify(B * layers[l].positions(), layers[l], work.outputs[l], in.biases + first, work.inputs[l + 1]);
    layer_outputs(geometry, B, work, l + 1);
  }
  for (int b = 0; b < B; ++b)
    for (int n = 0; n < layers[last].outputs; ++n)
      work.outputs[last][b * layers[last].width + n] += in.biases[first + n];

  float* g = work.gradients[last];
  out.loss = take_loss(layers[last], batch, 1, work.outputs[last], g).mean;
  std::memset(out.biases + first, 0, sizeof(float) * layers[last].outputs);
  for (int b = 0; b < B; ++b)
    for (int n = 0; n < layers[last].outputs; ++n) out.biases[first + n] += g[b * layers[last].width + n];
  for (int l = last; l >= 0; --l) {
    if (l < last) {
      first -= layers[l].outputs;
      rectify_back(B * layers[l].positions(), layers[l], work.inputs[l + 1], work.gradients[l], out.biases + first);
    }
    layer_gradients(geometry, batch, work, l);
  }
  each_run(geometry, work, [&](int l, int at, const float* from, int run) {
    for (int k = 0; k < run; ++k) out.weights[at + k] = l == 0 ? from[k] / kMaxPixel : from[k];
  });
}

}  // namespace
}  // namespace bpn
