// AXI4-Lite to a bus of single accesses: a write is answered a clock later, a read as soon as `read_ready`.
module bpn_axi_lite #(
    parameter int ADDRESS_W = 10
) (
    input logic clk,
    input logic rst_n,

    input logic [ADDRESS_W-1:0] s_awaddr,
    input logic s_awvalid,
    output logic s_awready,
    input logic [31:0] s_wdata,
    input logic [3:0] s_wstrb,
    input logic s_wvalid,
    output logic s_wready,
    output logic [1:0] s_bresp,
    output logic s_bvalid,
    input logic s_bready,
    input logic [ADDRESS_W-1:0] s_araddr,
    input logic s_arvalid,
    output logic s_arready,
    output logic [31:0] s_rdata,
    output logic [1:0] s_rresp,
    output logic s_rvalid,
    input logic s_rready,

    output logic write,
    output logic [ADDRESS_W-3:0] write_register,
    output logic [31:0] write_data,
    input logic write_refused,  // in the clock after `write`, in which register and data still are there

    output logic read,  // until `read_ready`
    output logic [ADDRESS_W-3:0] read_register,
    input logic read_ready,
    input logic [31:0] read_data,
    input logic read_refused
);
  localparam logic [1:0] OKAY = 2'b00, SLVERR = 2'b10;
  logic address_held, data_held, whole, written;
  wire unused = &{1'b0, s_awaddr[1:0], s_araddr[1:0]};  // registers are words

  assign s_awready = !address_held;
  assign s_wready = !data_held;
  wire both = address_held && data_held && !written && !s_bvalid;
  assign write = both && whole;
  assign s_arready = !read && !s_rvalid;

  always_ff @(posedge clk) begin
    if (s_awvalid && s_awready) begin
      address_held <= 1'b1;
      write_register <= s_awaddr[ADDRESS_W-1:2];
    end
    if (s_wvalid && s_wready) begin
      data_held <= 1'b1;
      write_data <= s_wdata;
      whole <= s_wstrb == 4'hf;
    end
    if (s_bvalid && s_bready) s_bvalid <= 1'b0;
    written <= both;
    if (written) begin
      {address_held, data_held} <= '0;
      s_bvalid <= 1'b1;
      s_bresp <= whole && !write_refused ? OKAY : SLVERR;
    end

    if (s_arvalid && s_arready) begin
      read <= 1'b1;
      read_register <= s_araddr[ADDRESS_W-1:2];
    end
    if (read && read_ready) begin
      read <= 1'b0;
      s_rvalid <= 1'b1;
      s_rdata <= read_refused ? '0 : read_data;
      s_rresp <= read_refused ? SLVERR : OKAY;
    end
    if (s_rvalid && s_rready) s_rvalid <= 1'b0;

    if (!rst_n) {address_held, data_held, written, s_bvalid, read, s_rvalid} <= '0;
  end
endmodule
