/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A lossless serial line for UARTE0 of the simulated board.
 *
 * The stock pseudoterminal backend drops bytes when the reader is slow, because its writes do not
 * block. Here the simulation waits for the reader instead, so every byte arrives. The hardware
 * model still spends the line's own time on each byte (start, data and stop bits at the baud rate
 * that the firmware set), so the firmware sees the load that a real line would be.
 *
 *   -hil_uart=PATH         an existing pseudoterminal, or a file for output only
 *   -hil_commands=FILE     what the host sends and when: lines "local time in us, bytes in hex",
 *                          in order of time
 *   -hil_uart_times=FILE   when the bytes left: little-endian records
 *                          { u64 bytes sent so far, u64 local time in us at the end of the last },
 *                          one per burst, and one every 100 simulated ms as a sign of life
 */
#include "NHW_config.h"
#include "NHW_peri_types.h"

#include "NHW_UART_backend_if.h"
#include "bs_cmd_line.h"
#include "bs_dynargs.h"
#include "bs_tracing.h"
#include "bs_types.h"
#include "bs_utils.h"
#include "nsi_hw_scheduler.h"
#include "nsi_hws_models_if.h"
#include "nsi_tasks.h"

/* After the hardware models' headers: some of their names are macros in termios.h. */
#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

#define UART_INSTANCE 0
#define POLL_PERIOD_US 1000
#define COMMAND_MAX 256
#define SIGN_OF_LIFE_PERIOD_US 100000

/* A burst is cut here, so that a line that is never idle is still reported every 2.56 ms. */
#define TX_BURST_MAX 256

static struct {
	char *line_path;
	char *times_path;
	char *commands_path;
	int tx_fd;
	int rx_fd; /* Non-blocking; -1 when the line is output only */
	int times_fd;

	uint8_t tx[TX_BURST_MAX];
	size_t tx_len;
	uint64_t tx_total;
	bs_time_t tx_idle_timer; /* When the last byte's stop bit has left */

	bool rx_on;
	FILE *commands;
	bs_time_t command_us; /* When the next one is due; TIME_NEVER after the last */
	uint8_t command[COMMAND_MAX];
	size_t command_len;
	uint8_t rx[COMMAND_MAX];
	size_t rx_len;
	size_t rx_pos;
	bs_time_t rx_timer; /* End of the byte being received, or the next poll */

	bs_time_t life_timer;
} line = {
	.tx_fd = -1,
	.rx_fd = -1,
	.times_fd = -1,
	.tx_idle_timer = TIME_NEVER,
	.rx_timer = TIME_NEVER,
	.life_timer = TIME_NEVER,
	.command_us = TIME_NEVER,
};

static bs_time_t serial_line_timer = TIME_NEVER;

static void update_timer(void)
{
	serial_line_timer = BS_MIN(BS_MIN(line.tx_idle_timer, line.rx_timer), line.life_timer);
	nsi_hws_find_next_event();
}

static void write_all(int fd, const void *data, size_t size, const char *path)
{
	const uint8_t *cursor = data;

	while (size > 0) {
		const ssize_t written = write(fd, cursor, size);

		if (written >= 0) {
			cursor += written;
			size -= (size_t)written;
		} else if (errno != EINTR) {
			bs_trace_error_time_line("%s: cannot write: %s\n", path, strerror(errno));
		}
	}
}

static void put_u64(uint8_t *out, uint64_t value)
{
	for (int i = 0; i < 8; i++) {
		out[i] = (uint8_t)(value >> (8 * i));
	}
}

static void log_time(bs_time_t local_us)
{
	uint8_t record[16];

	if (line.times_fd < 0) {
		return;
	}
	put_u64(&record[0], line.tx_total);
	put_u64(&record[8], local_us);
	write_all(line.times_fd, record, sizeof(record), line.times_path);
}

static void flush_tx(bs_time_t end_us)
{
	line.tx_idle_timer = TIME_NEVER;
	if (line.tx_len == 0) {
		return;
	}
	write_all(line.tx_fd, line.tx, line.tx_len, line.line_path);
	line.tx_total += line.tx_len;
	line.tx_len = 0;
	log_time(end_us);
}

/* Called by the model when the start bit of a byte leaves. */
static void tx_byte(uint inst, uint16_t data)
{
	const bs_time_t end_us = nsi_hws_get_time() + nhw_uarte_one_byte_time(inst);

	line.tx[line.tx_len++] = (uint8_t)data;
	if (line.tx_len == TX_BURST_MAX) {
		flush_tx(end_us);
	} else {
		line.tx_idle_timer = end_us;
	}
	update_timer();
}

static void rts_changed(uint inst, bool new_level)
{
	/* The line has no flow control: a host that overruns the node loses bytes, as it would
	 * on the board.
	 */
	(void)inst;
	(void)new_level;
}

static void bad_command(const char *text)
{
	bs_trace_error_line("%s: not \"local time in us,bytes in hex\": %s\n", line.commands_path,
			    text);
}

static void read_next_command(void)
{
	char text[2 * COMMAND_MAX + 32];
	unsigned long long due_us;
	int at;

	line.command_us = TIME_NEVER;
	if (line.commands == NULL || fgets(text, sizeof(text), line.commands) == NULL) {
		return;
	}
	if (sscanf(text, "%llu,%n", &due_us, &at) != 1) {
		bad_command(text);
	}
	line.command_us = due_us;
	for (line.command_len = 0; text[at] != '\n' && text[at] != '\0'; at += 2) {
		unsigned int byte;

		if (line.command_len == COMMAND_MAX || sscanf(&text[at], "%2x", &byte) != 1) {
			bad_command(text);
		}
		line.command[line.command_len++] = (uint8_t)byte;
	}
}

/* Bytes stay in the pseudoterminal until the receiver is on, so that what the host wrote before
 * the node had booted is not lost.
 */
static void enable_changed(uint inst, uint8_t tx_enabled, uint8_t rx_enabled)
{
	(void)tx_enabled;
	const bool rx_enabled_now = rx_enabled && !line.rx_on;

	line.rx_on = rx_enabled;
	if ((line.rx_fd >= 0 || line.commands != NULL) && rx_enabled_now) {
		/* A byte counts only if the receiver was on for all of it. */
		line.rx_timer = nsi_hws_get_time() + nhw_uarte_one_byte_time(inst) + 1;
		update_timer();
	}
}

static bool fetch_rx(void)
{
	if (line.rx_pos < line.rx_len) {
		return true;
	}
	line.rx_pos = 0;
	line.rx_len = 0;
	if (line.command_us <= nsi_hws_get_time()) {
		memcpy(line.rx, line.command, line.command_len);
		line.rx_len = line.command_len;
		read_next_command();
	} else if (line.rx_fd >= 0) {
		const ssize_t got = read(line.rx_fd, line.rx, sizeof(line.rx));

		line.rx_len = got > 0 ? (size_t)got : 0;
	}
	return line.rx_len > 0;
}

static void rx_event(void)
{
	if (!line.rx_on) {
		line.rx_timer = TIME_NEVER;
	} else if (fetch_rx()) {
		line.rx_timer += nhw_uarte_one_byte_time(UART_INSTANCE);
		nhw_UARTE_digest_Rx_byte(UART_INSTANCE, line.rx[line.rx_pos++]);
	} else {
		line.rx_timer += POLL_PERIOD_US;
	}
}

static void serial_line_event(void)
{
	const bs_time_t now = serial_line_timer;

	if (line.tx_idle_timer == now) {
		flush_tx(now);
	}
	if (line.rx_timer == now) {
		rx_event();
	}
	if (line.life_timer == now) {
		line.life_timer += SIGN_OF_LIFE_PERIOD_US;
		log_time(now);
	}
	update_timer();
}

/* After the UART's own events of the same instant: they may start the next byte. */
NSI_HW_EVENT(serial_line_timer, serial_line_event, 900);

/* Bytes must pass unchanged both ways, whatever the terminal was set to. */
static void make_raw(int fd)
{
	struct termios attributes;

	if (tcgetattr(fd, &attributes) != 0) {
		bs_trace_error_line("%s: cannot read the terminal's settings: %s\n", line.line_path,
				    strerror(errno));
	}
	attributes.c_iflag &= ~(IGNBRK | BRKINT | PARMRK | ISTRIP | INLCR | IGNCR | ICRNL | IXON);
	attributes.c_oflag &= ~OPOST;
	attributes.c_lflag &= ~(ECHO | ECHONL | ICANON | ISIG | IEXTEN);
	attributes.c_cflag &= ~(CSIZE | PARENB);
	attributes.c_cflag |= CS8;
	attributes.c_cc[VMIN] = 1;
	attributes.c_cc[VTIME] = 0;
	if (tcsetattr(fd, TCSANOW, &attributes) != 0) {
		bs_trace_error_line("%s: cannot make the terminal raw: %s\n", line.line_path,
				    strerror(errno));
	}
}

static int open_or_exit(const char *path, int flags)
{
	const int fd = open(path, flags | O_NOCTTY | O_CLOEXEC, 0600);

	if (fd < 0) {
		bs_trace_error_line("%s: cannot be opened: %s\n", path, strerror(errno));
	}
	return fd;
}

static void serial_line_init(void)
{
	if (line.line_path == NULL) {
		return;
	}
	line.tx_fd = open_or_exit(line.line_path, O_RDWR);
	if (isatty(line.tx_fd)) {
		make_raw(line.tx_fd);
		/* Opened twice, because blocking is a property of the open description. */
		line.rx_fd = open_or_exit(line.line_path, O_RDONLY | O_NONBLOCK);
	}
	if (line.commands_path != NULL) {
		line.commands = fopen(line.commands_path, "r");
		if (line.commands == NULL) {
			bs_trace_error_line("%s: cannot be opened: %s\n", line.commands_path,
					    strerror(errno));
		}
		read_next_command();
	}
	if (line.times_path != NULL) {
		line.times_fd = open_or_exit(line.times_path, O_WRONLY | O_CREAT | O_TRUNC);
		line.life_timer = SIGN_OF_LIFE_PERIOD_US;
	}

	struct backend_if backend = {
		.tx_byte_f = tx_byte,
		.RTS_pin_toggle_f = rts_changed,
		.uart_enable_notify_f = enable_changed,
	};

	nhw_UARTE_backend_register(UART_INSTANCE, &backend);
	nhw_UARTE_CTS_lowered(UART_INSTANCE); /* The host is always ready to receive */
	update_timer();
}

NSI_TASK(serial_line_init, HW_INIT, 100); /* Before the UART itself, which is at 200 */

static void close_if_open(int *fd)
{
	if (*fd >= 0) {
		close(*fd);
		*fd = -1;
	}
}

static void serial_line_exit(void)
{
	flush_tx(nsi_hws_get_time());
	close_if_open(&line.tx_fd);
	close_if_open(&line.rx_fd);
	close_if_open(&line.times_fd);
	if (line.commands != NULL) {
		fclose(line.commands);
		line.commands = NULL;
	}
}

NSI_TASK(serial_line_exit, ON_EXIT_PRE, 100);

static void serial_line_register_options(void)
{
	static bs_args_struct_t options[] = {
		{
			.option = "hil_uart",
			.name = "path",
			.type = 's',
			.dest = (void *)&line.line_path,
			.descript = "Connect UARTE0 without loss to this existing pseudoterminal, or "
				    "write its output to this existing file",
		},
		{
			.option = "hil_commands",
			.name = "file",
			.type = 's',
			.dest = (void *)&line.commands_path,
			.descript = "With -hil_uart: send the node what this file says and when "
				    "(lines \"local us,bytes in hex\")",
		},
		{
			.option = "hil_uart_times",
			.name = "file",
			.type = 's',
			.dest = (void *)&line.times_path,
			.descript = "With -hil_uart: write to this file when the bytes left (records "
				    "of u64 bytes so far, u64 local us)",
		},
		ARG_TABLE_ENDMARKER,
	};

	bs_add_extra_dynargs(options);
}

NSI_TASK(serial_line_register_options, PRE_BOOT_1, 200);
