// What the two banks hold, and which one frames begin with. Only a bank whose set was verified can be selected, and what
// is selected stays verified: its set can be replaced only after another one, or none, was selected.
module bpn_banks (
    input logic clk,
    input logic rst_n,

    input logic begun,  // a set is about to replace what this bank holds
    input logic begun_bank,
    input logic verified,  // a whole set was right
    input logic load_bank,
    input logic [bpn::GEOMETRY_W-1:0] load_geometry,
    input logic [31:0] load_epoch,
    input logic [31:0] load_crc,

    input logic select,
    input logic [1:0] select_banks,  // by bank: one, or none
    output logic select_refused,  // in the same clock

    output logic [1:0] valid,
    output logic [1:0] selected,
    output logic [2*bpn::GEOMETRY_W-1:0] geometries,
    output logic [63:0] epochs,
    output logic [63:0] crcs
);
  // A load may begin in the clock in which its bank is to be selected: the load goes first.
  wire [1:0] doomed = begun ? 2'b01 << begun_bank : 2'b00;
  assign select_refused = select && (select_banks == 2'b11 || (select_banks & ~(valid & ~doomed)) != '0);

  wire [1:0] filled = verified ? 2'b01 << load_bank : 2'b00;

  always_ff @(posedge clk) begin
    valid <= (valid & ~doomed) | filled;
    if (select && !select_refused) selected <= select_banks;
    if (!rst_n) {valid, selected} <= '0;
  end

  generate
    for (genvar bank = 0; bank < 2; bank = bank + 1) begin : gen_bank
      always_ff @(posedge clk)
        if (filled[bank]) begin
          geometries[bank*bpn::GEOMETRY_W+:bpn::GEOMETRY_W] <= load_geometry;
          epochs[bank*32+:32] <= load_epoch;
          crcs[bank*32+:32] <= load_crc;
        end
    end
  endgenerate
endmodule
