// What both kinds of network do alike: the products of one layer, forward and backward, and the loss.
#pragma once

#include "minibatch.h"
#include "products.h"

namespace bpn {
namespace {

// Gradients of layer l's weights and, but for the first layer, of its inputs, from that of its outputs.
inline void layer_gradients(const Geometry& geometry, const Batch& batch, const Workspace& work, int l) {
  const Layer& layer = geometry.layers[l];
  const int B = batch.size, values = layer.positions() * layer.width;
  const float* g = work.gradients[l];
  float* dw = work.weight_gradients[l];
  std::memset(dw, 0, sizeof(float) * layer.width * layer.rows * padded(layer.run));
  if (l == 0) {
    for (int b = 0; b < B; ++b)
      add_weight_gradients(layer, layer.size, layer.size, layer.step_x, batch.pixels[b], g + b * values, dw,
                           work.extents + b * layer.in_rows());
    return;
  }
  const float* x = work.inputs[l];
  if (layer.connected)
    add_weight_gradients(layer, 1, B, layer.image, x, g, dw);  // one row of B patches
  else
    for (int b = 0; b < B; ++b)
      add_weight_gradients(layer, layer.size, layer.size, layer.step_x, x + b * layer.image, g + b * values, dw);
  input_gradients(layer, B, g, work.weights[l], work.gradients[l - 1]);
}

// J = 1/2 (y - P)^2 with P = scale o, section IV-C: the share of its mean, and the gradients of log scale and of o.
// Of an action of several dimensions, P is the sum over the outputs that it takes, one of each.
struct Loss {
  float mean, log_scale;
};
inline Loss take_loss(const Layer& last, const Batch& batch, float scale, const float* o, float* g) {
  double loss = 0, scale_gradient = 0;
  std::memset(g, 0, sizeof(float) * batch.size * last.width);
  for (int b = 0; b < batch.size; ++b) {
    const int64_t* taken = batch.taken + b * batch.dimensions;
    const float* of_image = o + b * last.width;
    float P = scale * of_image[taken[0]];
    for (int d = 1; d < batch.dimensions; ++d) P += scale * of_image[taken[d]];
    const float error = P - batch.targets[b];
    loss += 0.5 * error * error;
    scale_gradient += double(error) * P;
    for (int d = 0; d < batch.dimensions; ++d) g[b * last.width + taken[d]] = error * scale / batch.total;
  }
  return {static_cast<float>(loss / batch.total), static_cast<float>(scale_gradient / batch.total)};
}

// The neighbours that a patch's row has in the weight vector too: all of it, or the channels of one position.
struct Runs {
  int count, length, step;

  explicit Runs(const Layer& layer) : count(1), length(layer.run), step(layer.run) {
    if (layer.in_channels < layer.in_width) count = layer.columns(), length = layer.in_channels, step = layer.in_width;
  }
};

// Calls f(value's index in the weight vector's row, as stored) for every input of a dot product.
template <class F>
inline void each_input(const Layer& layer, F&& f) {
  const Runs runs(layer);
  int from = 0;
  for (int i = 0; i < layer.rows; ++i)
    for (int j = 0; j < runs.count; ++j)
      for (int c = 0; c < runs.length; ++c, ++from) f(from, i * layer.run + j * runs.step + c);
}

// Where conv1's weight of output n and stored input k lies in [eight outputs][row][together][output][input].
template <int Together>
inline int together_at(const Layer& layer, int n, int k) {
  constexpr int N = kTogetherOutputs;
  const int groups = (layer.run + Together - 1) / Together, row = k / layer.run, column = k % layer.run;
  return (((n / N * layer.rows + row) * groups + column / Together) * N + n % N) * Together + column % Together;
}

// Calls f(layer, where it begins in the weight vector, gradients, how many) for every run of the vector.
template <class F>
inline void each_run(const Geometry& geometry, const Workspace& work, F&& f) {
  for (int l = 0, at = 0; l < geometry.count; ++l) {
    const Layer& layer = geometry.layers[l];
    const Runs runs(layer);
    for (int n = 0; n < layer.outputs; ++n)
      for (int i = 0; i < layer.rows; ++i)
        for (int j = 0; j < runs.count; ++j, at += runs.length)
          f(l, at, work.weight_gradients[l] + (n * layer.rows + i) * padded(layer.run) + j * runs.step, runs.length);
  }
}

}  // namespace
}  // namespace bpn
