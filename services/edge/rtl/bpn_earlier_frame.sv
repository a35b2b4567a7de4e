// What a frame will be to the next one, as the earlier of two: conv1 is linear, so that o of its channels, kept for every
// position until the next frame completes that position, stands for its pixels.
module bpn_earlier_frame (
    input logic clk,
    input logic rst_n,

    // As bpn_window_sums.
    input logic [8*bpn::BYTES-1:0] bytes,
    input logic [9*bpn::PAIRS-1:0] pairs,
    input logic [32*bpn::BYTES-1:0] weights,
    input logic fed,
    input logic fed_first,
    input logic early,  // a block's last beat
    input logic [bpn::BLOCK_W-1:0] early_position,
    input logic [bpn::ROW_W-1:0] early_row,
    input logic first_of_four,
    input logic updated,
    input logic [bpn::BLOCK_W-1:0] position,
    input logic complete,  // in the clock after `updated`, where that completes the position

    output logic [8*bpn::EARLIER_W-1:0] earlier  // of the frame before: two clocks after `early`
);
  localparam int CHANNELS = 8;
  localparam int S_W = bpn::SUM_W;
  localparam int E_W = bpn::EARLIER_W;
  localparam logic [8:0] LAST = 9'(2 * bpn::CONV1_WORDS - 1);

  logic [9*S_W-1:0] sums;
  logic [CHANNELS*E_W-1:0] o;
  logic [8:0] read_position, write_position;
  wire completes = early && early_position != '1 && early_row[1:0] == 2'd3 && early_row > bpn::ROW_W'(3);

  bpn_window_sums u_sums (
      .clk,
      .bytes,
      .pairs,
      .weights,
      .fed,
      .fed_first,
      .early_position,
      .first_of_four,
      .updated,
      .position,
      .sums
  );

  // Read before it is written: the frame that reads a position writes it for the next one four clocks later.
  bpn_ram #(
      .DEPTH(512),
      .LANES(1),
      .LANE (CHANNELS * E_W)
  ) u_kept (
      .clk,
      .write(complete),
      .write_address(write_position),
      .write_data(o),
      .read_address(read_position),
      .read_data(earlier)
  );

  always_ff @(posedge clk) begin
    for (int i = 0; i < CHANNELS; i = i + 1)
      o[i*E_W+:E_W] <= E_W'({sums[i*S_W+:S_W], 1'b0}) - E_W'(sums[8*S_W+:S_W]);
    if (completes) read_position <= read_position == LAST ? '0 : read_position + 1'b1;
    if (complete) write_position <= write_position == LAST ? '0 : write_position + 1'b1;
    if (!rst_n) {read_position, write_position} <= '0;
  end
endmodule
