// One minibatch of a binarized network: forward pass, loss and all gradients. Compiled once for each path.
#pragma once

#include <cmath>

#include "layers.h"
#include "norm.h"
#include "pixels.h"

namespace bpn {
namespace {

inline float sign_of(float x) { return x >= 0 ? 1.0f : -1.0f; }

// Sign(w) in the layouts that the products read. Padding stays zero.
inline void take_signs(const Geometry& geometry, const Parameters& in, const Workspace& work) {
  const float* latent = in.latent;
  for (int l = 0; l < geometry.count; ++l) {
    const Layer& layer = geometry.layers[l];
    const int fan_in = layer.fan_in();
    for (int n = 0; n < layer.outputs; ++n, latent += layer.true_fan_in()) {
      float* signs = work.weights[l] + n * fan_in;
      each_input(layer, [&](int from, int to) { signs[to] = sign_of(latent[from]); });
      if (l == 0)
        for (int k = 0; k < fan_in; ++k)
          work.pixel_signs[together_at<kTogetherPixels>(layer, n, k)] = static_cast<int8_t>(signs[k]);
    }
    if (l > 0) pack_signs(layer, work.weights[l], work.sign_bits[l]);
  }
}

inline void take_norms(const Geometry& geometry, const Parameters& in, const Workspace& work) {
  int first = 0;
  for (int l = 0; l < geometry.norms(); ++l) {
    const int outputs = geometry.layers[l].outputs;
    std::memcpy(work.gamma[l], in.gamma + first, sizeof(float) * outputs);
    std::memcpy(work.beta[l], in.beta + first, sizeof(float) * outputs);
    first += outputs;
  }
}

// dJ/dSign(w) as dJ/dw: straight through where |w| <= 1.
inline void give_latent(const Geometry& geometry, const float* latent, const Workspace& work, float* out) {
  each_run(geometry, work, [&](int, int at, const float* from, int run) {
    for (int k = 0; k < run; ++k) out[at + k] = std::fabs(latent[at + k]) < kPassBound ? from[k] : 0.0f;
  });
}

inline void gradients(const Geometry& geometry, const Batch& batch, const Parameters& in, const Workspace& work,
                      Gradients& out) {
  const Layer* layers = geometry.layers;
  const int B = batch.size, last = geometry.count - 1;
  take_signs(geometry, in, work);
  take_norms(geometry, in, work);

  const int conv1_values = layers[0].positions() * layers[0].width;
  for (int b = 0; b < B; ++b) {
    Extent* const extents = work.extents + b * layers[0].in_rows();
    take_extents(layers[0], batch.pixels[b], extents);
    convolve_pixels(layers[0], batch.pixels[b], extents, b + 1 < B ? batch.pixels[b + 1] : nullptr, work.pixel_signs,
                    work.outputs[0] + b * conv1_values);
  }
  for (int l = 0; l < last; ++l) {
    normalize(batch, layers[l], work.outputs[l], work.gamma[l], work.beta[l], work.norm_scale[l], work.inputs[l + 1],
              work.input_bits[l + 1], layers[l + 1].bit_bytes());
    count_outputs(layers[l + 1], B, work.input_bits[l + 1], work.sign_bits[l + 1], work.outputs[l + 1]);
  }

  const Loss loss = take_loss(layers[last], batch, std::exp(in.log_scale), work.outputs[last], work.gradients[last]);
  out.loss = loss.mean, out.log_scale = loss.log_scale;
  float padded_gamma[kMaxOutputs], padded_beta[kMaxOutputs];
  int first = 0;
  for (int l = 0; l < geometry.norms(); ++l) first += layers[l].outputs;
  for (int l = last; l >= 0; --l) {
    const Layer& layer = layers[l];
    if (l < last) {
      normalize_back(batch, layer, work.gradients[l], work.outputs[l], work.gamma[l], work.beta[l], work.norm_scale[l],
                     padded_gamma, padded_beta);
      first -= layer.outputs;
      std::memcpy(out.gamma + first, padded_gamma, sizeof(float) * layer.outputs);
      std::memcpy(out.beta + first, padded_beta, sizeof(float) * layer.outputs);
    }
    layer_gradients(geometry, batch, work, l);
  }
  give_latent(geometry, in.latent, work, out.latent);
}

}  // namespace
}  // namespace bpn
