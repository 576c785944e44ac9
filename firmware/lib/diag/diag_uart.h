/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * The diagnostic line: frames and text lines out, frames (commands) in.
 *
 * Producers never wait for the line. What does not fit the ring is dropped whole and counted;
 * a dropped frame still takes its sequence number, so the reader sees the loss as well.
 *
 * The first frame given to the line after boot must be HELLO: that is how a reader tells a
 * restart from a loss.
 */
#ifndef BV_DIAG_UART_H_
#define BV_DIAG_UART_H_

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Takes one good frame from the host, in the system work queue. */
typedef void (*diag_uart_command_cb)(uint8_t type, const uint8_t *payload, size_t len);

/**
 * Open the line.
 *
 * @param on_command takes frames from the host; NULL ignores them.
 * @return 0, or the negative errno of the UART driver.
 */
int diag_uart_init(diag_uart_command_cb on_command);

/** Send one frame. Threads only. @p type and @p payload as in the wire table. */
void diag_uart_frame(uint8_t type, const uint8_t *payload, size_t len);

/** Send @p text, which holds no NUL, and a line end. Threads only. */
void diag_uart_line(const char *text);

/**
 * Wait until everything given to the line has been sent, and take nothing more: producers wait for
 * ever. For the last moment before a reset.
 */
void diag_uart_close(void);

/** Count one line that its producer had to drop before it came here. */
void diag_uart_count_dropped(void);

/** Frames and lines dropped because the line was full, since boot. */
uint32_t diag_uart_dropped(void);

#ifdef __cplusplus
}
#endif

#endif /* BV_DIAG_UART_H_ */
