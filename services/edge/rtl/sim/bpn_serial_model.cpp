// The serial shell of the core behind a C interface: a line at whose other end are two queues of bytes.

#include <cstdint>
#include <deque>
#include <memory>

#include "Vbpn_serial.h"
#include "verilated.h"

namespace {

constexpr unsigned kClocks = 8;  // to a bit; the top's parameter

struct Model {
  VerilatedContext context;
  std::unique_ptr<Vbpn_serial> top{new Vbpn_serial(&context)};
  std::deque<std::uint8_t> to_send, received;
  unsigned send_bits = 0, send_clocks = 0, shift = 0;
  unsigned receive_bits = 0, receive_clocks = 0, in = 0;

  Model() {
    top->rx = 1;
    top->rst_n = 0;
    for (int i = 0; i < 4; ++i) step();
    top->rst_n = 1;
  }

  void step() {
    if (send_clocks > 0) {
      --send_clocks;
    } else if (send_bits > 0) {
      top->rx = shift & 1;
      shift >>= 1;
      --send_bits;
      send_clocks = kClocks - 1;
    } else if (!to_send.empty()) {
      shift = 1u << 9 | unsigned{to_send.front()} << 1;
      to_send.pop_front();
      send_bits = 10;
    }
    top->clk = 0;
    top->eval();
    top->clk = 1;
    top->eval();
    if (receive_clocks > 0) {
      --receive_clocks;
    } else if (receive_bits > 0) {
      in = in >> 1 | unsigned{top->tx} << 9;
      if (--receive_bits > 0)
        receive_clocks = kClocks - 1;
      else if ((in & 1) == 0 && (in >> 9) == 1)
        received.push_back(in >> 1 & 255);
    } else if (!top->tx) {
      receive_bits = 10;
      receive_clocks = kClocks / 2;
      in = 0;
    }
  }
};

Model& of(void* model) { return *static_cast<Model*>(model); }

}  // namespace

#pragma GCC visibility push(default)
extern "C" {

void* bpn_serial_create() { return new Model(); }
void bpn_serial_destroy(void* model) { delete static_cast<Model*>(model); }

void bpn_serial_send(void* model, const std::uint8_t* bytes, std::size_t count) {
  of(model).to_send.insert(of(model).to_send.end(), bytes, bytes + count);
}

// Runs until so many bytes have come, for at most so many clocks; how many came.
std::size_t bpn_serial_receive(void* model, std::uint8_t* bytes, std::size_t count, std::uint64_t clocks) {
  std::size_t got = 0;
  while (got < count && clocks-- > 0) {
    of(model).step();
    if (of(model).received.empty()) continue;
    bytes[got++] = of(model).received.front();
    of(model).received.pop_front();
  }
  return got;
}
}
