#include <algorithm>
#include <cstdio>
#include <exception>
#include <memory>
#include <new>

#include "blob.h"
#include "bpn_kernel.h"
#include "packed_network.h"
#include "paths.h"

static_assert(BPN_MAX_LAYERS == bpn::kMaxLayers && BPN_MAX_DIMENSIONS == bpn::kMaxActionDims);

namespace {

std::vector<bpn::SignMatrix> matrices(const bpn::Blob& blob) {
  std::vector<bpn::SignMatrix> found;
  for (size_t l = 0; l < blob.signs.size(); ++l)
    found.push_back({blob.signs[l].data(), l < blob.thresholds.size() ? blob.thresholds[l].data() : nullptr});
  return found;
}

bpn_policy described(const bpn::Blob& blob) {
  const bpn::LayerShape &first = blob.shapes.front(), &last = blob.shapes.back();
  bpn_policy policy{};
  policy.schema = blob.schema;
  policy.channels = first.in_channels, policy.image_px = first.in_size, policy.actions = last.outputs;
  policy.dimensions = static_cast<int32_t>(blob.choices.size());
  std::copy(blob.choices.begin(), blob.choices.end(), policy.choices);
  policy.layers = static_cast<int32_t>(blob.shapes.size());
  std::transform(blob.shapes.begin(), blob.shapes.end(), policy.layer, [](const bpn::LayerShape& shape) {
    return bpn_layer{shape.in_size, shape.in_channels, shape.kernel, shape.stride, shape.out_size, shape.outputs};
  });
  policy.scale = blob.scale;
  std::copy(blob.run.begin(), blob.run.end(), policy.run);
  policy.attempt = blob.attempt, policy.version = blob.version;
  return policy;
}

}  // namespace

struct bpn_kernel {
  bpn_kernel(const bpn::Blob& blob, const bpn::Path& path)
      : policy(described(blob)),
        network(blob.shapes, matrices(blob)),
        forward(network.is_paper() ? path.paper : path.any),
        scratch(network.scratch_size()),
        activations(network.activations(scratch.data())) {}

  bpn_policy policy;
  bpn::PackedNetwork network;
  bpn::Forward* forward;
  bpn::Memory scratch;
  bpn::Activations activations;
};

bpn_kernel* bpn_kernel_load(const void* blob, size_t size, const char* path, char* reason) {
  const auto refused = [&](const char* why) -> bpn_kernel* {
    if (reason) std::snprintf(reason, BPN_REASON_SIZE, "%s", why);
    return nullptr;
  };
  const bpn::Path* const found = bpn::find_path(path);
  if (!found) return refused("this processor has no such path");
  try {
    return new bpn_kernel(bpn::decode(static_cast<const uint8_t*>(blob), size), *found);
  } catch (const std::bad_alloc&) {
    return refused("there is no memory");
  } catch (const std::exception& error) {
    return refused(error.what());
  }
}

void bpn_kernel_free(bpn_kernel* kernel) { delete kernel; }

const bpn_policy* bpn_kernel_policy(const bpn_kernel* kernel) { return &kernel->policy; }

void bpn_kernel_run(bpn_kernel* kernel, const uint8_t* observation, int32_t* outputs) {
  kernel->forward(kernel->network.layers(), observation, kernel->activations);
  kernel->network.outputs(kernel->activations, outputs);
}

size_t bpn_kernel_trace(const bpn_kernel* kernel, int layer, uint8_t* bits) {
  if (layer < 0 || layer + 1 >= kernel->policy.layers) return 0;
  const bpn::LayerShape& shape = kernel->network.shapes()[layer];
  bpn::unpack_bits(kernel->activations.maps[layer], shape, bits);
  return size_t(shape.out_size) * shape.out_size * shape.outputs;
}

uint64_t bpn_kernel_checksum(const bpn_kernel* kernel) { return kernel->network.checksum(); }

const char* bpn_kernel_path(int index) {
  const bpn::PathList paths = bpn::compiled_paths();
  for (int i = 0; i < paths.count; ++i)
    if (paths.first[i].supported() && index-- == 0) return paths.first[i].name;
  return nullptr;
}
