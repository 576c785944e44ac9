/* SPDX-License-Identifier: Apache-2.0 */
#include "watchdog.h"

#include <stdbool.h>
#include <string.h>

#include <zephyr/device.h>
#include <zephyr/drivers/watchdog.h>
#include <zephyr/kernel.h>
#include <zephyr/sys/atomic.h>

#include "fail.h"
#include "last_words.h"
#include "wire.h"

/* A piece of work is seen to be stuck within a period of the limit. */
#define PERIOD_MS   500U
#define LOOKS       (CONFIG_BV_WATCHDOG_STUCK_MS / PERIOD_MS)
/* Some periods' worth: the kernel's clock alone feeds it. */
#define HARDWARE_MS (4U * PERIOD_MS)

static const char *const names[WATCHDOG_PARTS] = {"main", "sensor", "link", "fusion"};

static struct {
	/* Of begins and ends: odd within a piece of work. */
	atomic_t count;
	k_tid_t thread;
	/* As the last look found it, and how many looks ago that began. */
	atomic_val_t last;
	uint32_t looks;
} parts[WATCHDOG_PARTS];

void watchdog_begin(enum watchdog_part part)
{
	parts[part].thread = k_current_get();
	(void)atomic_inc(&parts[part].count);
	fail_if_told(part);
}

void watchdog_end(enum watchdog_part part)
{
	(void)atomic_inc(&parts[part].count);
}

#if defined(CONFIG_CPU_CORTEX_M)

/* What the processor put on the thread's stack when it was last interrupted (ARMv7-M, B1.5.6). */
static void find_place(k_tid_t thread, struct last_words *words)
{
	const uint32_t *frame = (const uint32_t *)(thread == k_current_get()
							   ? __get_PSP()
							   : thread->callee_saved.psp);

	words->lr = frame[5];
	words->pc = frame[6];
}

#else

static void find_place(k_tid_t thread, struct last_words *words)
{
	ARG_UNUSED(thread);
	ARG_UNUSED(words);
}

#endif

static _Noreturn void stuck(enum watchdog_part part)
{
	struct last_words words = {.code = WIRE_FAULT_CODE_WATCHDOG};
	const char *thread = k_thread_name_get(parts[part].thread);

	(void)strncpy(words.part, names[part], sizeof(words.part) - 1U);
	(void)strncpy(words.thread, thread == NULL ? "" : thread, sizeof(words.thread) - 1U);
	find_place(parts[part].thread, &words);
	last_words_say(&words);
}

static void look_after(enum watchdog_part part)
{
	const atomic_val_t count = atomic_get(&parts[part].count);
	const bool works = (count & 1) != 0;

	parts[part].looks = works && count == parts[part].last ? parts[part].looks + 1U : 0U;
	parts[part].last = count;
	if (parts[part].looks >= LOOKS) {
		stuck(part);
	}
}

#if DT_NODE_HAS_STATUS(DT_NODELABEL(wdt0), okay) && defined(CONFIG_WATCHDOG)

static const struct device *const hardware = DEVICE_DT_GET(DT_NODELABEL(wdt0));
static int channel = -1;

static int start_hardware(void)
{
	const struct wdt_timeout_cfg config = {
		.window = {.min = 0U, .max = HARDWARE_MS},
		.flags = WDT_FLAG_RESET_SOC,
	};

	if (!device_is_ready(hardware)) {
		return -ENODEV;
	}
	channel = wdt_install_timeout(hardware, &config);
	return channel < 0 ? channel : wdt_setup(hardware, WDT_OPT_PAUSE_HALTED_BY_DBG);
}

static void feed_hardware(void)
{
	if (channel >= 0) {
		(void)wdt_feed(hardware, channel);
	}
}

#else

static int start_hardware(void)
{
	return 0;
}

static void feed_hardware(void)
{
}

#endif

static void look(struct k_timer *timer)
{
	ARG_UNUSED(timer);
	for (int part = 0; part < WATCHDOG_PARTS; part++) {
		look_after((enum watchdog_part)part);
	}
	feed_hardware();
}

static K_TIMER_DEFINE(look_timer, look, NULL);

int watchdog_start(void)
{
	const int err = start_hardware();

	k_timer_start(&look_timer, K_MSEC(PERIOD_MS), K_MSEC(PERIOD_MS));
	return err;
}
