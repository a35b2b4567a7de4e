// A block RAM with one write port, in lanes of LANE bits, and one read port: the word of an address is there two
// clocks after it, since the second register takes a block RAM's slow output off the path that follows.
//
// What is read in the clock in which it is written is never used. Block RAMs differ in what that is, and logic that makes
// them alike would be in the longest path, so none is asked for; in simulation it is wrong, which the tests would notice.
module bpn_ram #(
    parameter int DEPTH = 512,
    parameter int LANES = 8,
    parameter int LANE = 32
) (
    input logic clk,
    input logic [LANES-1:0] write,  // which lanes
    input logic [$clog2(DEPTH)-1:0] write_address,
    input logic [LANE-1:0] write_data,
    input logic [$clog2(DEPTH)-1:0] read_address,
    output logic [LANES*LANE-1:0] read_data
);
  generate
    for (genvar lane = 0; lane < LANES; lane = lane + 1) begin : gen_lane
      (* no_rw_check *) logic [LANE-1:0] words[DEPTH];
      logic [LANE-1:0] word;

      always_ff @(posedge clk) begin
        if (write[lane]) words[write_address] <= write_data;
`ifdef SYNTHESIS
        word <= words[read_address];
`else
        word <= words[read_address] ^ {LANE{write[lane] && write_address == read_address}};
`endif
        read_data[lane*LANE+:LANE] <= word;
      end
    end
  endgenerate
endmodule
