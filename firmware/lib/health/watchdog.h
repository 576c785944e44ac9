/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Nobody works for ever on one thing.
 *
 * Each part says when it begins a piece of work and when it has ended it; waiting for something to
 * do is no work. A piece that takes longer than BV_WATCHDOG_STUCK_MS reboots the node, which then
 * tells whose it was. That is looked after from the kernel's timer interrupt, which alone feeds the
 * chip's watchdog: interrupts locked for as long end in a reset by that, and HELLO's reset reason
 * tells it.
 */
#ifndef BV_WATCHDOG_H_
#define BV_WATCHDOG_H_

#ifdef __cplusplus
extern "C" {
#endif

enum watchdog_part {
	WATCHDOG_MAIN,
	WATCHDOG_SENSOR,
	WATCHDOG_LINK,
	WATCHDOG_FUSION,
	WATCHDOG_PARTS,
};

#if defined(CONFIG_BV_WATCHDOG)

/** Begin to look after the parts. @return 0, or the chip's watchdog's negative errno. */
int watchdog_start(void);

/** The calling thread begins a piece of this part's work. One thread a part. */
void watchdog_begin(enum watchdog_part part);

/** It has ended it. */
void watchdog_end(enum watchdog_part part);

#else

static inline int watchdog_start(void)
{
	return 0;
}

static inline void watchdog_begin(enum watchdog_part part)
{
	(void)part;
}

static inline void watchdog_end(enum watchdog_part part)
{
	(void)part;
}

#endif

#ifdef __cplusplus
}
#endif

#endif /* BV_WATCHDOG_H_ */
