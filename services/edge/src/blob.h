// The weight blob, read as docs/weight-blob.md says: schemas 1 and 2.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "layout.h"

namespace bpn {

struct Blob {
  int schema;
  std::vector<LayerShape> shapes;
  std::vector<int> choices;  // of each dimension of an action
  float scale;               // lambda
  std::array<uint8_t, 16> run;
  uint32_t attempt, version;
  std::vector<std::vector<int8_t>> signs;        // of each layer, -1 and +1, [outputs][fan_in]
  std::vector<std::vector<int32_t>> thresholds;  // of each but the last
};

// Why bytes are no blob, in one line.
class BlobError : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Raises BlobError for whatever the page says must be refused, and std::bad_alloc. No memory is taken before the sizes
// are known to be within the limits.
Blob decode(const uint8_t* data, size_t size);

}  // namespace bpn
