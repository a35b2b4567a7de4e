// One minibatch: forward pass, loss and all gradients. Compiled once for each path.
#pragma once

#include <cmath>

#include "minibatch.h"
#include "norm.h"
#include "pixels.h"
#include "products.h"

namespace bpn {
namespace {

inline float sign_of(float x) { return x >= 0 ? 1.0f : -1.0f; }

// Sign(w) in the layouts that the products read. Padding stays zero.
inline void take_signs(const Geometry& geometry, const Parameters& in, const Workspace& work) {
  const float* latent = in.latent;
  for (int l = 0; l < kLayers; ++l) {
    const Layer& layer = geometry.layers[l];
    const int inputs = geometry.true_fan_in(l), fan_in = layer.fan_in();
    for (int n = 0; n < layer.outputs; ++n, latent += inputs) {
      float* signs = work.signs[l] + n * fan_in;
      for (int k = 0; k < inputs; ++k) signs[k] = sign_of(latent[k]);
      if (work.transposed[l])
        for (int k = 0; k < inputs; ++k) work.transposed[l][k * layer.width + n] = signs[k];
      if (l == 0)
        for (int k = 0; k < inputs; ++k)
          work.pixel_signs[k / 8 * 64 + n * 8 + k % 8] = static_cast<int8_t>(signs[k]);
    }
  }
}

inline void take_norms(const Geometry& geometry, const Parameters& in, const Workspace& work) {
  int first = 0;
  for (int l = 0; l < kNorms; ++l) {
    const int outputs = geometry.layers[l].outputs;
    std::memcpy(work.gamma[l], in.gamma + first, sizeof(float) * outputs);
    std::memcpy(work.beta[l], in.beta + first, sizeof(float) * outputs);
    first += outputs;
  }
}

// J = 1/2 (y - P)^2, section IV-C: its mean, and the gradients of log lambda and of o_5.
inline void take_loss(const Layer& last, const Batch& batch, float log_scale, const float* o, float* g,
                      Gradients& out) {
  const float scale = std::exp(log_scale);
  double loss = 0, scale_gradient = 0;
  std::memset(g, 0, sizeof(float) * batch.size * last.width);
  for (int b = 0; b < batch.size; ++b) {
    const int64_t taken = b * last.width + batch.actions[b];
    const float P = scale * o[taken], error = P - batch.targets[b];
    loss += 0.5 * error * error;
    scale_gradient += double(error) * P;
    g[taken] = error * scale / batch.size;
  }
  out.loss = static_cast<float>(loss / batch.size);
  out.log_scale = static_cast<float>(scale_gradient / batch.size);
}

// dJ/dSign(w) as dJ/dw: straight through where |w| <= 1.
inline void give_latent(const Geometry& geometry, const float* latent, const Workspace& work, float* out) {
  for (int l = 0; l < kLayers; ++l) {
    const Layer& layer = geometry.layers[l];
    const int run = l == kLayers - 1 ? geometry.run5 : layer.run;
    for (int n = 0; n < layer.outputs; ++n)
      for (int i = 0; i < layer.rows; ++i, latent += run, out += run) {
        const float* from = work.sign_gradients[l] + (n * layer.rows + i) * padded(layer.run);
        for (int k = 0; k < run; ++k) out[k] = std::fabs(latent[k]) < kPassBound ? from[k] : 0.0f;
      }
  }
}

inline void gradients(const Geometry& geometry, const Batch& batch, const Parameters& in,
                      const Workspace& work, Gradients& out) {
  const Layer* layers = geometry.layers;
  const int B = batch.size, last = kLayers - 1;
  take_signs(geometry, in, work);
  take_norms(geometry, in, work);

  const int conv1_values = layers[0].positions() * layers[0].width;
  for (int b = 0; b < B; ++b)
    convolve_pixels(layers[0], batch.pixels[b], work.pixel_signs, work.normalized[0] + b * conv1_values);
  for (int l = 0; l < last; ++l) {
    const Layer &layer = layers[l], &next = layers[l + 1];
    normalize(B * layer.positions(), layer.width, work.normalized[l], work.gamma[l], work.beta[l],
              work.norm_scale[l], work.inputs[l + 1]);
    if (next.size > 1) convolve(next, B, work.inputs[l + 1], work.transposed[l + 1], work.normalized[l + 1]);
    else connect(next, B, work.inputs[l + 1], work.signs[l + 1], work.normalized[l + 1]);
  }

  take_loss(layers[last], batch, in.log_scale, work.normalized[last], work.gradients[last], out);
  float padded_gamma[kMaxNodes], padded_beta[kMaxNodes];
  int first = 0;
  for (int l = 0; l < kNorms; ++l) first += layers[l].outputs;
  for (int l = last; l >= 0; --l) {
    const Layer& layer = layers[l];
    float* g = work.gradients[l];
    if (l < last) {
      normalize_back(B * layer.positions(), layer.width, g, work.normalized[l], work.gamma[l], work.beta[l],
                     work.norm_scale[l], padded_gamma, padded_beta);
      first -= layer.outputs;
      std::memcpy(out.gamma + first, padded_gamma, sizeof(float) * layer.outputs);
      std::memcpy(out.beta + first, padded_beta, sizeof(float) * layer.outputs);
    }
    float* dw = work.sign_gradients[l];
    std::memset(dw, 0, sizeof(float) * layer.width * layer.rows * padded(layer.run));
    if (l == 0) {
      for (int b = 0; b < B; ++b)
        add_sign_gradients(layer, layer.size, layer.size, layer.step_x, batch.pixels[b],
                           g + b * conv1_values, dw);
    } else {
      const float* x = work.inputs[l];
      if (layer.size == 1) add_sign_gradients(layer, 1, B, layer.image, x, g, dw);  // one row of B patches
      else
        for (int b = 0; b < B; ++b)
          add_sign_gradients(layer, layer.size, layer.size, layer.step_x, x + b * layer.image,
                             g + b * layer.positions() * layer.width, dw);
      input_gradients(layer, B, g, work.signs[l], work.gradients[l - 1]);
    }
  }
  give_latent(geometry, in.latent, work, out.latent);
}

}  // namespace
}  // namespace bpn
