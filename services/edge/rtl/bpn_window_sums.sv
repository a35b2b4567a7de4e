// What conv1's positions sum up under one set of weights: of each position that a row of pixels belongs to, its sums so far.
//
// A block of 4x4 pixels belongs to 2x2 output positions, so that each beat adds to 32 sums at once. Of a position only
// its sums so far are kept, twice: of the output row that the image rows begin, and of the one that they complete.
module bpn_window_sums (
    input logic clk,

    input logic [8*bpn::BYTES-1:0] bytes,
    input logic [9*bpn::PAIRS-1:0] pairs,
    input logic [32*bpn::BYTES-1:0] weights,

    // bpn::TREE clocks later: the beat's place.
    input logic fed,
    input logic fed_first,  // of its block

    // A clock before and two clocks after: the position that a block's last beat adds to, one to the left.
    input logic [bpn::BLOCK_W-1:0] early_position,
    input logic first_of_four,  // rows of blocks; with the clock after
    input logic updated,
    input logic [bpn::BLOCK_W-1:0] position,

    output logic [9*bpn::SUM_W-1:0] sums  // with `updated`, of what an eighth row completes: eight M, and T
);
  localparam int CHANNELS = 8;
  localparam int Q_W = bpn::BEAT_SUM_W;
  localparam int R_W = bpn::ROW_SUM_W;
  localparam int S_W = bpn::SUM_W;
  localparam int SUMS = 2 * CHANNELS + 2;  // kept for a position: top and bottom, eight M and a T

  // 32 masked sums of a beat, and the sum of all its bytes.
  logic [32*Q_W-1:0] masked;
  logic [Q_W-1:0] total;
  generate
    for (genvar i = 0; i < 32; i = i + 1) begin : gen_masked
      bpn_masked_sum u_sum (
          .clk,
          .bytes(bytes),
          .pairs,
          .mask(weights[i*bpn::BYTES+:bpn::BYTES]),
          .sum(masked[i*Q_W+:Q_W])
      );
    end
  endgenerate
  bpn_masked_sum u_total (
      .clk,
      .bytes(bytes),
      .pairs,
      .mask('1),
      .sum(total)
  );

  // Of a row of pixels: `left` sums a block as the left half of a position, `sum` what that position gets from the
  // row, once its right half, the next block, is added. Eight of a kernel's top, eight of its bottom, and T.
  logic [17*R_W-1:0] left, sum;
  logic [17*R_W-1:0] left_in, right_in;
  generate
    for (genvar i = 0; i < 16; i = i + 1) begin : gen_in
      localparam int LANE = (i / CHANNELS) * 2;
      assign left_in[i*R_W+:R_W] = R_W'(masked[(LANE*CHANNELS+i%CHANNELS)*Q_W+:Q_W]);
      assign right_in[i*R_W+:R_W] = R_W'(masked[((LANE+1)*CHANNELS+i%CHANNELS)*Q_W+:Q_W]);
    end
    assign left_in[16*R_W+:R_W]  = R_W'(total);
    assign right_in[16*R_W+:R_W] = R_W'(total);
    for (genvar i = 0; i < 17; i = i + 1) begin : gen_row
      always_ff @(posedge clk)
        if (fed) begin
          left[i*R_W+:R_W] <= (fed_first ? '0 : left[i*R_W+:R_W]) + left_in[i*R_W+:R_W];
          sum[i*R_W+:R_W] <= (fed_first ? left[i*R_W+:R_W] : sum[i*R_W+:R_W]) + right_in[i*R_W+:R_W];
        end
    end
  endgenerate

  logic [SUMS*S_W-1:0] kept, now;

  bpn_ram #(
      .DEPTH(2 ** bpn::BLOCK_W),
      .LANES(1),
      .LANE (SUMS * S_W)
  ) u_kept (
      .clk,
      .write(updated),
      .write_address(position),
      .write_data(now),
      .read_address(early_position),
      .read_data(kept)
  );

  generate
    for (genvar i = 0; i < 9; i = i + 1) begin : gen_kept
      localparam int TOP = i * S_W;
      localparam int BOTTOM = (9 + i) * S_W;
      localparam int FROM_TOP = (i < CHANNELS ? i : 16) * R_W;
      localparam int FROM_BOTTOM = (CHANNELS + i) * R_W;  // T, the last, is the same for both
      wire [S_W-1:0] top = first_of_four ? '0 : kept[TOP+:S_W];
      wire [S_W-1:0] bottom = first_of_four ? kept[TOP+:S_W] : kept[BOTTOM+:S_W];
      always_ff @(posedge clk) begin
        now[TOP+:S_W] <= top + S_W'(sum[FROM_TOP+:R_W]);
        now[BOTTOM+:S_W] <= bottom + S_W'(sum[FROM_BOTTOM+:R_W]);
      end
    end
  endgenerate
  assign sums = now[9*S_W+:9*S_W];
endmodule
