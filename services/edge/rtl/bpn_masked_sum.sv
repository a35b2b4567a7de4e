// The sum of those bytes whose mask bit is 1, bpn::TREE clocks later: a tree with a register at every level. The first level
// adds nothing: of two bytes it takes none, one, the other, or their sum, which all trees share.
module bpn_masked_sum (
    input logic clk,
    input logic [8*bpn::BYTES-1:0] bytes,
    input logic [9*bpn::PAIRS-1:0] pairs,  // sums of two bytes each
    input logic [bpn::BYTES-1:0] mask,
    output logic [bpn::BEAT_SUM_W-1:0] sum
);
  localparam int W = bpn::BEAT_SUM_W;

  generate
    if (bpn::BYTES == 1) begin : gen_byte
      wire unused = &{1'b0, pairs};
      always_ff @(posedge clk) sum <= mask[0] ? bytes : '0;
    end else begin : gen_tree
      // Nodes of all levels one after the other: the pairs, then sums of two nodes each, of which the last has all.
      localparam int NODES = 2 * bpn::PAIRS - 1;
      logic [NODES*W-1:0] nodes;
      for (genvar i = 0; i < bpn::PAIRS; i = i + 1) begin : gen_pair
        always_ff @(posedge clk)
          case (mask[2*i+:2])
            2'b00: nodes[i*W+:W] <= '0;
            2'b01: nodes[i*W+:W] <= W'(bytes[16*i+:8]);
            2'b10: nodes[i*W+:W] <= W'(bytes[16*i+8+:8]);
            default: nodes[i*W+:W] <= W'(pairs[9*i+:9]);
          endcase
      end
      for (genvar i = bpn::PAIRS; i < NODES; i = i + 1) begin : gen_sum
        localparam int FIRST = 2 * (i - bpn::PAIRS);
        always_ff @(posedge clk) nodes[i*W+:W] <= nodes[FIRST*W+:W] + nodes[(FIRST+1)*W+:W];
      end
      assign sum = nodes[(NODES-1)*W+:W];
    end
  endgenerate
endmodule
