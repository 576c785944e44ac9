/* SPDX-License-Identifier: Apache-2.0 */
#include "last_words.h"

#include <stddef.h>
#include <string.h>

#include <zephyr/fatal.h>
#include <zephyr/kernel.h>
#include <zephyr/sys/crc.h>
#include <zephyr/sys/printk.h>
#include <zephyr/sys/reboot.h>

#include "diag_report.h"
#include "retained.h"
#include "wire.h"

struct kept {
	struct last_words words;
	uint32_t crc32;
};
BUILD_ASSERT(sizeof(struct kept) <= RETAINED_SIZE);

static uint32_t crc_of(const struct kept *kept)
{
	return crc32_ieee((const uint8_t *)kept, offsetof(struct kept, crc32));
}

void last_words_say(const struct last_words *words)
{
	uint8_t bytes[RETAINED_SIZE] = {0};
	struct kept kept = {.words = *words};

	kept.crc32 = crc_of(&kept);
	memcpy(bytes, &kept, sizeof(kept));
	retained_put(bytes);
	sys_reboot(SYS_REBOOT_COLD);
}

static void name_thread(char name[LAST_WORDS_NAME_SIZE], k_tid_t thread)
{
	const char *found = thread == NULL ? NULL : k_thread_name_get(thread);

	if (found != NULL) {
		(void)strncpy(name, found, LAST_WORDS_NAME_SIZE - 1U);
	}
}

/* Overrides Zephyr's, which would stop for ever. */
void k_sys_fatal_error_handler(unsigned int reason, const struct arch_esf *esf)
{
	struct last_words words = {
		.code = reason == K_ERR_STACK_CHK_FAIL ? WIRE_FAULT_CODE_STACK
						       : WIRE_FAULT_CODE_ASSERT,
		.reason = (uint16_t)reason,
	};

#if defined(CONFIG_CPU_CORTEX_M)
	if (esf != NULL) {
		words.pc = esf->basic.pc;
		words.lr = esf->basic.lr;
	}
#else
	ARG_UNUSED(esf);
#endif
	name_thread(words.thread, k_current_get());
	last_words_say(&words);
}

void last_words_report(void)
{
	static const uint8_t nothing[RETAINED_SIZE];
	uint8_t bytes[RETAINED_SIZE];
	char detail[80]; /* the frame takes what it has room for */
	struct kept kept;

	retained_get(bytes);
	memcpy(&kept, bytes, sizeof(kept));
	/* All zero has a CRC that is not: what was told is not told again. */
	if (kept.crc32 != crc_of(&kept)) {
		return;
	}
	retained_put(nothing);
	kept.words.thread[LAST_WORDS_NAME_SIZE - 1U] = '\0';
	kept.words.part[LAST_WORDS_NAME_SIZE - 1U] = '\0';
	if (kept.words.code == WIRE_FAULT_CODE_WATCHDOG) {
		(void)snprintk(detail, sizeof(detail), "rebooted: %s stuck in %s",
			       kept.words.part, kept.words.thread);
	} else {
		(void)snprintk(detail, sizeof(detail), "rebooted: error %u in %s, LR %x",
			       kept.words.reason, kept.words.thread, kept.words.lr);
	}
	diag_report_fault(kept.words.code, kept.words.pc, detail);
}
