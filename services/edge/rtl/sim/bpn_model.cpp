// The simulated core behind a C interface: an AXI4-Lite master, and two streams that are fed from queues. Gaps and
// delays are drawn at random, as often as asked for. One thread at a time may use a model.

#include <cstdint>
#include <cstring>
#include <deque>
#include <memory>
#include <random>
#include <vector>

#include "Vbpn_core.h"
#include "verilated.h"

namespace {

constexpr int kTimedOut = -1;
constexpr std::uint64_t kPatience = 1'000'000;  // clocks that an answer may take

struct Beat {
  std::uint8_t bytes[16];
  bool last;
};

struct Stream {
  std::deque<Beat> beats;
  unsigned gaps = 0;  // of 256 clocks without a beat
  bool offered = false;
};

struct Model {
  VerilatedContext context;
  std::unique_ptr<Vbpn_core> top;
  Stream streams[2];
  std::mt19937 random;
  unsigned delays = 0;  // of 256 clocks in which the master of the registers dawdles
  std::uint64_t clocks = 0;

  explicit Model(unsigned seed) : top(new Vbpn_core(&context)), random(seed) { reset(); }

  bool happens(unsigned of_256) { return of_256 != 0 && (random() & 255) < of_256; }

  // A beat that was offered stays until it is taken.
  void offer(Stream& stream, void* data, std::size_t size, CData& valid, CData& last) {
    if (!stream.offered) stream.offered = !stream.beats.empty() && !happens(stream.gaps);
    valid = stream.offered;
    if (!stream.offered) return;
    std::memcpy(data, stream.beats.front().bytes, size);
    last = stream.beats.front().last;
  }

  void take(Stream& stream, bool ready) {
    if (!stream.offered || !ready) return;
    stream.beats.pop_front();
    stream.offered = false;
  }

  void step() {
    offer(streams[0], &top->s_axis_pixels_tdata, PIXEL_BYTES, top->s_axis_pixels_tvalid, top->s_axis_pixels_tlast);
    offer(streams[1], &top->s_axis_weights_tdata, 4, top->s_axis_weights_tvalid, top->s_axis_weights_tlast);
    top->eval();
    const bool pixels = top->s_axis_pixels_tready, weights = top->s_axis_weights_tready;
    top->aclk = 1;
    top->eval();
    top->aclk = 0;
    take(streams[0], pixels && top->aresetn);
    take(streams[1], weights && top->aresetn);
    ++clocks;
  }

  void reset() {
    top->aresetn = 0;
    top->s_axi_awvalid = top->s_axi_wvalid = top->s_axi_bready = top->s_axi_arvalid = top->s_axi_rready = 0;
    for (int i = 0; i < 3; ++i) step();
    top->aresetn = 1;
    step();
  }

  int write(std::uint32_t address, std::uint32_t data, std::uint32_t strobes) {
    bool address_left = true, data_left = true;
    top->s_axi_awaddr = address;
    top->s_axi_wdata = data;
    top->s_axi_wstrb = strobes;
    for (std::uint64_t end = clocks + kPatience; clocks < end;) {
      top->s_axi_awvalid = address_left && (top->s_axi_awvalid || !happens(delays));
      top->s_axi_wvalid = data_left && (top->s_axi_wvalid || !happens(delays));
      top->s_axi_bready = !happens(delays);
      top->eval();
      const bool address_taken = top->s_axi_awvalid && top->s_axi_awready;
      const bool data_taken = top->s_axi_wvalid && top->s_axi_wready;
      const bool answered = top->s_axi_bvalid && top->s_axi_bready;
      const int answer = top->s_axi_bresp;
      step();
      if (address_taken) address_left = top->s_axi_awvalid = false;
      if (data_taken) data_left = top->s_axi_wvalid = false;
      if (answered) {
        top->s_axi_bready = 0;
        return answer;
      }
    }
    return kTimedOut;
  }

  int read(std::uint32_t address, std::uint32_t* data) {
    bool address_left = true;
    top->s_axi_araddr = address;
    for (std::uint64_t end = clocks + kPatience; clocks < end;) {
      top->s_axi_arvalid = address_left && (top->s_axi_arvalid || !happens(delays));
      top->s_axi_rready = !happens(delays);
      top->eval();
      const bool taken = top->s_axi_arvalid && top->s_axi_arready;
      const bool answered = top->s_axi_rvalid && top->s_axi_rready;
      const int answer = top->s_axi_rresp;
      *data = top->s_axi_rdata;
      step();
      if (taken) address_left = top->s_axi_arvalid = false;
      if (answered) {
        top->s_axi_rready = 0;
        return answer;
      }
    }
    return kTimedOut;
  }
};

Model& of(void* model) { return *static_cast<Model*>(model); }

}  // namespace

#pragma GCC visibility push(default)
extern "C" {

void* bpn_create(unsigned seed) { return new Model(seed); }
void bpn_destroy(void* model) { delete static_cast<Model*>(model); }
void bpn_reset(void* model) { of(model).reset(); }

// 0 done, 2 refused, -1 no answer.
int bpn_write(void* model, std::uint32_t address, std::uint32_t data, std::uint32_t strobes) {
  return of(model).write(address, data, strobes);
}
int bpn_read(void* model, std::uint32_t address, std::uint32_t* data) { return of(model).read(address, data); }

// Appends beats to a stream (0 pixels, 1 weights); `last` marks the last of them.
void bpn_feed(void* model, int stream, const std::uint8_t* bytes, std::size_t beats, int last) {
  const std::size_t size = stream == 0 ? PIXEL_BYTES : 4;
  for (std::size_t i = 0; i < beats; ++i) {
    Beat beat = {};
    std::memcpy(beat.bytes, bytes + i * size, size);
    beat.last = last && i + 1 == beats;
    of(model).streams[stream].beats.push_back(beat);
  }
}

std::size_t bpn_unsent(void* model, int stream) { return of(model).streams[stream].beats.size(); }

void bpn_unfeed(void* model, int stream) {
  of(model).streams[stream].beats.clear();
  of(model).streams[stream].offered = false;
}

// How many of 256 clocks are gaps: in the pixels, in the weights, in the answers of the registers' master.
void bpn_dawdle(void* model, unsigned pixels, unsigned weights, unsigned registers) {
  of(model).streams[0].gaps = pixels;
  of(model).streams[1].gaps = weights;
  of(model).delays = registers;
}

void bpn_run(void* model, std::uint64_t clocks) {
  while (clocks-- > 0) of(model).step();
}

// Runs until the interrupt, at most so many clocks; 1 if it came.
int bpn_run_to_interrupt(void* model, std::uint64_t clocks) {
  while (clocks-- > 0 && !of(model).top->irq) of(model).step();
  return of(model).top->irq;
}

std::uint64_t bpn_clocks(void* model) { return of(model).clocks; }
}
