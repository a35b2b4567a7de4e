/* Reads observations from standard input until its end; of each it writes every layer's sums and the best choice of
 * each dimension, as little-endian int32. The exported policy stands before it. */
#include <stdio.h>

static void put(int32_t value) {
  const uint32_t bits = (uint32_t)value;
  int byte;
  for (byte = 0; byte < 4; ++byte) putchar((int)(bits >> (8 * byte) & 255u));
}

void bpn_trace(int layer, int32_t sum) {
  (void)layer;
  put(sum);
}

int main(void) {
  static uint8_t observation[BPN_CHANNELS * BPN_ROWS * BPN_COLUMNS];
  int32_t outputs[BPN_ACTIONS];
  int dimension;
  while (fread(observation, 1, sizeof observation, stdin) == sizeof observation) {
    bpn_infer(observation, outputs);
    for (dimension = 0; dimension < BPN_DIMENSIONS; ++dimension) put(bpn_best(outputs, dimension));
  }
  return 0;
}
