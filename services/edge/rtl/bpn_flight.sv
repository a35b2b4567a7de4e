// The frames in flight, at most two: one in conv1, one in the engine. Each keeps the bank and the sizes with which it
// began until its result is out, so that no frame ever sees a part of two weight sets.
module bpn_flight (
    input logic clk,
    input logic rst_n,

    input logic start,  // a frame begins
    input logic start_bank,
    input logic forget,  // the frame after this belongs to none before it
    input logic [bpn::G_STACKED:0] start_geometry,
    input logic end_of_pixels,
    input logic end_misaligned,
    input logic finish,  // the oldest frame has its result

    output logic full,
    output logic [1:0] in_use,  // by bank
    output logic newest,  // the half of conv1's map that the newest frame has
    output logic newest_bank,
    output logic newest_stacked,

    output logic active,  // there is a frame for the engine: the oldest
    output logic oldest,
    output logic oldest_bank,
    output logic oldest_misaligned,
    output logic oldest_alone,  // it is stacked, and there was no frame before: it has no result
    output logic [bpn::G_STACKED-1:0] oldest_geometry
);
  logic [1:0] count;
  logic [1:0] banks, misaligned, stacked, alone;
  logic [bpn::G_STACKED-1:0] geometry[2];

  assign full = count == 2'd2;
  assign active = count != 2'd0;
  assign newest_bank = banks[newest];
  assign oldest_bank = banks[oldest];
  assign newest_stacked = stacked[newest];
  assign oldest_misaligned = misaligned[oldest];
  assign oldest_alone = alone[oldest];
  assign oldest_geometry = geometry[oldest];
  assign in_use[1] = (active && banks[oldest]) || (full && banks[newest]);
  assign in_use[0] = (active && !banks[oldest]) || (full && !banks[newest]);

  // Whether what is kept of the frame before is of the weights that frames begin with.
  logic kept, keeps;
  always_ff @(posedge clk) begin
    if (start) keeps <= 1'b1;
    if (end_of_pixels) kept <= keeps && !end_misaligned;
    if (!rst_n || forget) {kept, keeps} <= '0;
  end

  wire [1:0] starting = !start ? 2'b00 : newest ? 2'b01 : 2'b10;  // by half
  wire [1:0] ending = !end_of_pixels ? 2'b00 : newest ? 2'b10 : 2'b01;

  always_ff @(posedge clk)
    if (!rst_n) begin
      count <= '0;
      newest <= 1'b1;
      oldest <= 1'b0;
    end else begin
      count <= count + 2'(start) - 2'(finish);
      newest <= newest ^ start;
      oldest <= oldest ^ finish;
    end

  generate
    for (genvar half = 0; half < 2; half = half + 1) begin : gen_half
      always_ff @(posedge clk) begin
        if (starting[half]) begin
          banks[half] <= start_bank;
          geometry[half] <= start_geometry[bpn::G_STACKED-1:0];
          stacked[half] <= start_geometry[bpn::G_STACKED];
          alone[half] <= start_geometry[bpn::G_STACKED] && !kept;
        end
        if (starting[half]) misaligned[half] <= 1'b0;
        else if (ending[half]) misaligned[half] <= end_misaligned;
      end
    end
  endgenerate
endmodule
