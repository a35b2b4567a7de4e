// The sum of those bytes whose mask bit is 1, LATENCY = bpn::TREE clocks later: a tree with a register at every level.
module bpn_masked_sum
(
    input logic clk,
    input logic [8*bpn::BYTES-1:0] bytes,
    input logic [bpn::BYTES-1:0] mask,
    output logic [bpn::BEAT_SUM_W-1:0] sum
);
  localparam int W = bpn::BEAT_SUM_W;
  logic [bpn::BYTES*W-1:0] leaves;

  generate
    for (genvar i = 0; i < bpn::BYTES; i = i + 1) begin : gen_leaf
      wire [7:0] masked = mask[i] ? bytes[8*i+:8] : 8'd0;
      assign leaves[i*W+:W] = W'(masked);
    end
    if (bpn::BYTES == 1) begin : gen_byte
      always_ff @(posedge clk) sum <= leaves;
    end else begin : gen_tree
      // Nodes of all levels one after the other: the leaves, then sums of two nodes each, of which the last has all.
      localparam int SUMS = bpn::BYTES - 1;
      logic [SUMS*W-1:0] sums;
      wire [2*SUMS*W-1:0] nodes = (2 * SUMS * W)'({sums, leaves});
      for (genvar i = 0; i < SUMS; i = i + 1) begin : gen_sum
        always_ff @(posedge clk) sums[i*W+:W] <= nodes[2*i*W+:W] + nodes[(2*i+1)*W+:W];
      end
      assign sum = sums[(SUMS-1)*W+:W];
    end
  endgenerate
endmodule
