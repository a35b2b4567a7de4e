// Bytes of a serial line to accesses of AXI4-Lite. Low byte first:
//
//   'R' register(2)                    -> answer(1) value(4)
//   'W' register(2) value(4)           -> answer(1)
//   'S' register(2) words(4) word(4).. -> answer(1): all words to the register, the last one to the next register
//
// The answer is 0, or 2 if an access was refused. Any other byte is passed over.
module bpn_serial_master (
    input logic clk,
    input logic rst_n,

    input logic received,
    input logic [7:0] received_byte,
    output logic send,
    output logic [7:0] send_byte,
    input logic ready,

    output logic [9:0] m_awaddr,
    output logic m_awvalid,
    input logic m_awready,
    output logic [31:0] m_wdata,
    output logic m_wvalid,
    input logic m_wready,
    input logic [1:0] m_bresp,
    input logic m_bvalid,
    output logic [9:0] m_araddr,
    output logic m_arvalid,
    input logic m_arready,
    input logic [31:0] m_rdata,
    input logic [1:0] m_rresp,
    input logic m_rvalid
);
  localparam logic [2:0] COMMAND = 0, REGISTER = 1, COUNT = 2, WORD = 3, WRITE = 4, READ = 5, ANSWER = 6;
  logic [2:0] state, bytes_left;
  logic is_read, is_stream;
  logic [15:0] address;
  logic [31:0] words_left;
  logic [31:0] shift;
  logic [1:0] answer;

  assign m_awaddr = is_stream && words_left == 32'd1 ? address[9:0] + 10'd4 : address[9:0];
  assign m_araddr = address[9:0];
  assign m_wdata = shift;
  assign send = state == ANSWER && ready;
  assign send_byte = shift[7:0];
  wire unused = &{1'b0, address[15:10]};

  always_ff @(posedge clk) begin
    if (received)
      case (state)
        COMMAND: begin
          is_read <= received_byte == "R";
          is_stream <= received_byte == "S";
          words_left <= 32'd1;
          answer <= '0;
          bytes_left <= 3'd2;
          if (received_byte == "R" || received_byte == "W" || received_byte == "S") state <= REGISTER;
        end
        REGISTER: begin
          address <= {received_byte, address[15:8]};
          bytes_left <= bytes_left - 1'b1;
          if (bytes_left == 3'd1) begin
            bytes_left <= 3'd4;
            state <= is_read ? READ : is_stream ? COUNT : WORD;
            m_arvalid <= is_read;
          end
        end
        COUNT: begin
          words_left <= {received_byte, words_left[31:8]};
          bytes_left <= bytes_left - 1'b1;
          if (bytes_left == 3'd1) begin
            bytes_left <= 3'd4;
            state <= WORD;
          end
        end
        WORD: begin
          shift <= {received_byte, shift[31:8]};
          bytes_left <= bytes_left - 1'b1;
          if (bytes_left == 3'd1) begin
            bytes_left <= 3'd4;
            state <= WRITE;
            {m_awvalid, m_wvalid} <= '1;
          end
        end
        default: ;
      endcase

    if (m_awvalid && m_awready) m_awvalid <= 1'b0;
    if (m_wvalid && m_wready) m_wvalid <= 1'b0;
    if (m_arvalid && m_arready) m_arvalid <= 1'b0;
    if (state == WRITE && m_bvalid) begin
      answer <= answer | m_bresp;
      words_left <= words_left - 1'b1;
      state <= WORD;
      if (words_left == 32'd1) begin
        shift <= {30'b0, answer | m_bresp};
        bytes_left <= 3'd1;
        state <= ANSWER;
      end
    end
    if (state == READ && m_rvalid) begin
      shift <= {m_rdata[23:0], 6'b0, m_rresp};
      answer <= '0;
      bytes_left <= 3'd5;
      address <= {8'b0, m_rdata[31:24]};
      state <= ANSWER;
    end
    if (send) begin
      shift <= {address[7:0], shift[31:8]};
      bytes_left <= bytes_left - 1'b1;
      if (bytes_left == 3'd1) state <= COMMAND;
    end

    if (!rst_n) begin
      state <= COMMAND;
      {m_awvalid, m_wvalid, m_arvalid} <= '0;
    end
  end
endmodule
