// What both kinds of network do alike: the products of one layer, forward and backward, and the loss.
#pragma once

#include "minibatch.h"
#include "products.h"

namespace bpn {
namespace {

// Outputs of layer l >= 1 from its inputs.
inline void layer_outputs(const Geometry& geometry, int B, const Workspace& work, int l) {
  const Layer& layer = geometry.layers[l];
  if (layer.size > 1) convolve(layer, B, work.inputs[l], work.transposed[l], work.outputs[l]);
  else connect(layer, B, work.inputs[l], work.weights[l], work.outputs[l]);
}

// Gradients of layer l's weights and, but for the first layer, of its inputs, from that of its outputs.
inline void layer_gradients(const Geometry& geometry, const Batch& batch, const Workspace& work, int l) {
  const Layer& layer = geometry.layers[l];
  const int B = batch.size, values = layer.positions() * layer.width;
  const float* g = work.gradients[l];
  float* dw = work.weight_gradients[l];
  std::memset(dw, 0, sizeof(float) * layer.width * layer.rows * padded(layer.run));
  if (l == 0) {
    for (int b = 0; b < B; ++b)
      add_weight_gradients(layer, layer.size, layer.size, layer.step_x, batch.pixels[b], g + b * values, dw);
    return;
  }
  const float* x = work.inputs[l];
  if (layer.size == 1) add_weight_gradients(layer, 1, B, layer.image, x, g, dw);  // one row of B patches
  else
    for (int b = 0; b < B; ++b)
      add_weight_gradients(layer, layer.size, layer.size, layer.step_x, x + b * layer.image, g + b * values, dw);
  input_gradients(layer, B, g, work.weights[l], work.gradients[l - 1]);
}

// J = 1/2 (y - P)^2 with P = scale o, section IV-C: the share of its mean, and the gradients of log scale and of o.
struct Loss {
  float mean, log_scale;
};
inline Loss take_loss(const Layer& last, const Batch& batch, float scale, const float* o, float* g) {
  double loss = 0, scale_gradient = 0;
  std::memset(g, 0, sizeof(float) * batch.size * last.width);
  for (int b = 0; b < batch.size; ++b) {
    const int64_t taken = b * last.width + batch.actions[b];
    const float P = scale * o[taken], error = P - batch.targets[b];
    loss += 0.5 * error * error;
    scale_gradient += double(error) * P;
    g[taken] = error * scale / batch.total;
  }
  return {static_cast<float>(loss / batch.total), static_cast<float>(scale_gradient / batch.total)};
}

// Calls f(layer, where it begins in the weight vector, gradients, how many) for every run of the vector.
template <class F>
inline void each_run(const Geometry& geometry, const Workspace& work, F&& f) {
  for (int l = 0, at = 0; l < kLayers; ++l) {
    const Layer& layer = geometry.layers[l];
    const int run = l == kLayers - 1 ? geometry.run5 : layer.run;
    for (int n = 0; n < layer.outputs; ++n)
      for (int i = 0; i < layer.rows; ++i, at += run)
        f(l, at, work.weight_gradients[l] + (n * layer.rows + i) * padded(layer.run), run);
  }
}

}  // namespace
}  // namespace bpn
