// A stream with one word that the host may push in: where there is no DMA, the host is the stream.
module bpn_push #(
    parameter int WIDTH = 32
) (
    input logic clk,
    input logic rst_n,

    input logic push,  // only while not `full`
    input logic [WIDTH-1:0] push_data,
    input logic push_last,
    output logic full,

    input logic [WIDTH-1:0] s_tdata,
    input logic s_tvalid,
    output logic s_tready,
    input logic s_tlast,

    output logic [WIDTH-1:0] m_tdata,
    output logic m_tvalid,
    input logic m_tready,
    output logic m_tlast
);
  logic [WIDTH-1:0] word;
  logic last;

  assign m_tvalid = full || s_tvalid;
  assign m_tdata = full ? word : s_tdata;
  assign m_tlast = full ? last : s_tlast;
  assign s_tready = m_tready && !full;

  always_ff @(posedge clk) begin
    if (push) begin
      word <= push_data;
      last <= push_last;
    end
    if (!rst_n) full <= 1'b0;
    else if (push) full <= 1'b1;
    else if (m_tready) full <= 1'b0;
  end
endmodule
