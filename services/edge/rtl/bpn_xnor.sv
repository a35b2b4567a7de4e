// The engine of every layer but the first: sixteen outputs by sixteen inputs in each clock, XNOR and popcount.
// A step's words come two clocks after it; its sums are there three clocks later. FC(N)'s sums grow by one
// input word at a time, so that those of all its outputs are kept in a memory.
module bpn_xnor (
    input logic clk,
    input logic rst_n,

    input logic step,
    input logic [1:0] layer,
    input logic [bpn::GROUP_W-1:0] group,
    input logic is_bias,
    input logic is_first,
    input logic is_last,

    input logic [15:0] inputs,  // two clocks after the step
    input logic [255:0] weights,  // of output i: bits 16 i and above; biases likewise

    output logic done,  // a sum is complete
    output logic [1:0] done_layer,
    output logic [bpn::GROUP_W-1:0] done_group,
    output logic [15:0] active,  // sum not below 0: what the next layer takes
    output logic [16*bpn::ACC_W-1:0] sums
);
  localparam int ACC_W = bpn::ACC_W;
  localparam int KEPT_W = bpn::KEPT_W;
  localparam int C_W = bpn::GROUP_W + 5;
  localparam int STAGES = 6;  // step, memory, memory's register, popcounts of four, of sixteen, sums
  logic [STAGES-1:1] valid;
  logic [C_W-1:0] along[STAGES-1:1];
  logic from_nothing, from_kept;  // of what goes into the sums

  function automatic logic [2:0] popcount(input logic [3:0] bits);
    popcount = 3'(bits[0]) + 3'(bits[1]) + 3'(bits[2]) + 3'(bits[3]);
  endfunction

  always_ff @(posedge clk) begin
    valid <= {valid[STAGES-2:1], step};
    along[1] <= {group, is_last, is_bias, is_first, layer};
    for (int i = 2; i < STAGES; i = i + 1) along[i] <= along[i-1];
    from_nothing <= along[3][2] || along[3][3];
    from_kept <= along[3][1:0] == 2'd2;
    if (!rst_n) valid <= '0;
  end

  // FC(N)'s sums, one word for sixteen outputs.
  logic [16*ACC_W-1:0] kept[2**KEPT_W];
  logic [16*ACC_W-1:0] kept_word;
  always_ff @(posedge clk) begin
    if (valid[5] && along[5][1:0] == 2'd2) kept[along[5][5+:KEPT_W]] <= sums;
    kept_word <= kept[along[3][5+:KEPT_W]];
  end

  generate
    for (genvar i = 0; i < 16; i = i + 1) begin : gen_output
      logic [ACC_W-1:0] bias, addend;
      logic [2:0] counts[4];
      wire [15:0] word = weights[16*i+:16];
      wire [ACC_W-1:0] so_far = from_nothing ? '0
          : from_kept ? kept_word[i*ACC_W+:ACC_W] : sums[i*ACC_W+:ACC_W];
      always_ff @(posedge clk) begin
        bias <= word[ACC_W-1:0];
        for (int k = 0; k < 4; k = k + 1) counts[k] <= popcount(~(word[4*k+:4] ^ inputs[4*k+:4]));
        addend <= along[3][3] ? bias
            : ACC_W'(counts[0]) + ACC_W'(counts[1]) + ACC_W'(counts[2]) + ACC_W'(counts[3]);
        if (valid[4]) sums[i*ACC_W+:ACC_W] <= so_far + addend;
      end
      assign active[i] = !sums[i*ACC_W+ACC_W-1];
    end
  endgenerate

  assign done = valid[5] && along[5][4];
  assign done_layer = along[5][1:0];
  assign done_group = along[5][C_W-1:5];
endmodule
