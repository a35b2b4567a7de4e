// The minibatch kernel's parts, and what the processor's multipliers alone would allow; docs/learner-speed.md.
//
//   g++ -std=c++20 -O3 -march=native -ffp-contract=fast -mprefer-vector-width=512 -Wno-psabi \
//       -I services/learner/src bench/learner_parts.cpp -o /tmp/learner_parts && /tmp/learner_parts
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "gradients.h"

using namespace bpn;

namespace {

constexpr int kImages = 32, kTransitions = 1200;
std::mt19937 generator(0);

template <class F>
double fastest_us(F&& f) {
  double best = 1e12;
  for (int i = 0; i < 50; ++i) {
    const auto start = std::chrono::steady_clock::now();
    f();
    best = std::min(best, std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start).count());
  }
  return best;
}

template <class F>
void report(const char* part, double macs, F&& f) {
  const double us = fastest_us(f);
  std::printf("%-22s %8.1f us", part, us);
  if (macs > 0) std::printf(" %8.1f GMAC/s", macs / us / 1e3);
  std::printf("\n");
}

float* floats(size_t count) {
  static std::vector<std::unique_ptr<float[]>> memory;
  memory.emplace_back(new float[count + kSlack]);
  std::uniform_real_distribution<float> uniform(-1, 1);
  for (size_t i = 0; i < count + kSlack; ++i) memory.back()[i] = uniform(generator);
  return memory.back().get();
}

uint64_t* bits(size_t words) {
  static std::vector<std::unique_ptr<uint64_t[]>> memory;
  memory.emplace_back(new uint64_t[words]());
  return memory.back().get();
}

// Twelve independent chains of fused multiply-adds: nothing to load, nothing to wait for.
void peak() {
  constexpr int kChains = 12, kSteps = 100'000;
  report("float32 peak", double(kChains) * kSteps * kLanes, [] {
    Floats sums[kChains] = {}, factor = Floats{} + 1.0001f;
    for (int i = 0; i < kSteps; ++i)
      each<kChains>([&](auto c) INLINE_LAMBDA {
        sums[c] = sums[c] * factor + factor;
        asm volatile("" : "+x"(sums[c]));
      });
  });
}

}  // namespace

int main() {
  const LayerShape tracking[] = {
      {84, 6, 8, 4, 8}, {20, 8, 4, 2, 16}, {9, 16, 3, 1, 16}, {7, 16, 7, 1, 100}, {1, 100, 1, 1, 7}};
  const Geometry geometry(tracking, 5);
  const Layer* layers = geometry.layers;
  Workspace work{};
  std::vector<Extent> extents(kImages * 84);
  work.extents = extents.data();
  for (int l = 0; l < geometry.count; ++l) {
    const Layer& layer = layers[l];
    const size_t values = size_t(kImages) * layer.positions() * layer.width;
    work.weights[l] = floats(layer.width * layer.fan_in());
    work.inputs[l] = floats(size_t(kImages) * layer.image);
    if (l > 0) {
      work.sign_bits[l] = bits(size_t(layer.width) * layer.patch_words());
      work.input_bits[l] = reinterpret_cast<uint8_t*>(bits(size_t(kImages) * layer.bit_bytes() / 8 + 1));
    }
    work.outputs[l] = floats(values), work.gradients[l] = floats(values);
    work.weight_gradients[l] = floats(layer.width * layer.rows * padded(layer.run));
    if (l < geometry.norms())
      work.norm_scale[l] = floats(layer.width), work.gamma[l] = floats(layer.width), work.beta[l] = floats(layer.width);
  }
  std::vector<int8_t> pixel_signs(layers[0].outputs * layers[0].fan_in(), 1);
  work.pixel_signs = pixel_signs.data();
  std::vector<uint8_t> pixels(size_t(kTransitions) * layers[0].image + kSlack);
  for (auto& pixel : pixels) pixel = generator() & 255;
  std::vector<const uint8_t*> images;
  for (int b = 0; b < kImages; ++b) images.push_back(pixels.data() + b * layers[0].image);
  const std::vector<int64_t> actions(kImages, 2);
  const Batch batch{kImages, images.data(), actions.data(), 1, floats(kImages), kImages};
  const Parameters parameters{floats(100'000), floats(1000), floats(1000), -1.6f};
  Gradients out{floats(100'000), floats(1000), floats(1000), 0, 0};

  peak();
  const double conv1 = double(kImages) * layers[0].positions() * layers[0].outputs * layers[0].fan_in();
  const int stride = layers[0].positions() * layers[0].width;
  const auto report_conv1 = [&] {
    report("extents", 0, [&] {
      for (int b = 0; b < kImages; ++b) take_extents(layers[0], images[b], work.extents + b * 84);
    });
    report("conv1 outputs", conv1, [&] {
      for (int b = 0; b < kImages; ++b)
        convolve_pixels(layers[0], images[b], work.extents + b * 84, nullptr, work.pixel_signs,
                        work.outputs[0] + b * stride);
    });
    report("conv1 sign gradient", conv1, [&] {
      for (int b = 0; b < kImages; ++b)
        add_weight_gradients(layers[0], 20, 20, layers[0].step_x, images[b], work.gradients[0] + b * stride,
                             work.weight_gradients[0], work.extents + b * 84);
    });
  };
  const auto report_whole = [&] {
    report("whole minibatch", 0, [&] { gradients(geometry, batch, parameters, work, out); });
    report("drawn from all of D", 0, [&] {
      for (const uint8_t*& image : images) image = pixels.data() + generator() % kTransitions * layers[0].image;
      gradients(geometry, batch, parameters, work, out);
    });
  };
  report_conv1();
  const char* names[] = {"conv1", "conv2", "conv3", "fc1", "fc2"};
  for (int l = 1; l < geometry.count; ++l) {
    const Layer& layer = layers[l];
    const double macs = double(kImages) * layer.positions() * layer.outputs * layer.fan_in();
    const auto part = [&](const char* what) { return std::string(names[l]) + what; };
    report(part(" outputs").c_str(), macs,
           [&] { count_outputs(layer, kImages, work.input_bits[l], work.sign_bits[l], work.outputs[l]); });
    report(part(" input gradient").c_str(), macs,
           [&] { input_gradients(layer, kImages, work.gradients[l], work.weights[l], work.inputs[l]); });
    report(part(" sign gradient").c_str(), macs, [&] {
      if (layer.connected)
        return add_weight_gradients(layer, 1, kImages, layer.image, work.inputs[l], work.gradients[l],
                                    work.weight_gradients[l]);
      for (int b = 0; b < kImages; ++b)
        add_weight_gradients(layer, layer.size, layer.size, layer.step_x, work.inputs[l] + b * layer.image,
                             work.gradients[l] + b * layer.positions() * layer.width, work.weight_gradients[l]);
    });
  }
  report("norms, forward", 0, [&] {
    for (int l = 0; l < geometry.norms(); ++l)
      normalize(batch, layers[l], work.outputs[l], work.gamma[l], work.beta[l], work.norm_scale[l], work.inputs[l + 1],
                work.input_bits[l + 1], layers[l + 1].bit_bytes());
  });
  report("norms, backward", 0, [&] {
    for (int l = 0; l < geometry.norms(); ++l)
      normalize_back(batch, layers[l], work.gradients[l], work.outputs[l], work.gamma[l], work.beta[l],
                     work.norm_scale[l], out.gamma, out.beta);
  });
  report("signs, latent", 0, [&] {
    take_signs(geometry, parameters, work);
    give_latent(geometry, parameters.latent, work, out.latent);
  });
  report_whole();

  std::printf("\nas a task draws them, two discs on black:\n");
  std::fill(pixels.begin(), pixels.end(), uint8_t{0});
  for (int image = 0; image < kTransitions; ++image)
    for (int disc = 0; disc < 2; ++disc) {
      uint8_t* at = pixels.data() + size_t(image) * layers[0].image + generator() % 72 * layers[0].row_stride +
                    generator() % 72 * 6;
      for (int y = 0; y < 12; ++y) std::fill_n(at + y * layers[0].row_stride, 12 * 6, uint8_t{200});
    }
  report_conv1();
  report_whole();
}
