/* SPDX-License-Identifier: Apache-2.0 */
#include "link.h"

#include <errno.h>
#include <string.h>

#include <zephyr/bluetooth/bluetooth.h>
#include <zephyr/bluetooth/conn.h>
#include <zephyr/bluetooth/gatt.h>
#include <zephyr/bluetooth/hci.h>
#include <zephyr/kernel.h>
#include <zephyr/sys/byteorder.h>

#include "link_role.h"
#include "link_security.h"
#include "watchdog.h"

#define CONN_INTERVAL_UNIT_US 1250U
#define RSSI_UNKNOWN          127

/* Pause before looking for the peer again after something was refused. */
#define RETRY_DELAY K_MSEC(200)
/* A connection attempt ends by itself within this time, one way or the other. */
#define CONNECT_TIMEOUT K_SECONDS(5)

struct value {
	uint8_t len;
	uint8_t bytes[LINK_VALUE_MAX];
};
BUILD_ASSERT(LINK_VALUE_MAX <= UINT8_MAX);
BUILD_ASSERT(LINK_VALUE_MAX + 3U <= CONFIG_BT_L2CAP_TX_MTU, "a message must fit one ATT value");
BUILD_ASSERT(CONFIG_BV_SUPERVISION_TIMEOUT * 10000 > 2 * CONFIG_BV_CONN_INTERVAL * 1250,
	     "the supervision timeout must exceed twice the connection interval");

K_MSGQ_DEFINE(tx_queue, sizeof(struct value), CONFIG_BV_LINK_QUEUE_DEPTH, 1);

static const struct link_callbacks *callbacks;
static struct bt_conn *current_conn;
static uint16_t current_handle;
static uint8_t last_connect_error;

static K_SEM_DEFINE(bluetooth_ready, 0, 1);
/* Given when a connection attempt has ended, well or badly. */
static K_SEM_DEFINE(attempt_ended, 0, 1);

static atomic_t is_connected;
static atomic_t is_ready;
static atomic_t disconnects;
static atomic_t tx_dropped;
static atomic_t bad_payloads;
static atomic_t drop_wanted;
static atomic_t hold_ms;
static atomic_t batches_sent;

static void on_connected(struct bt_conn *conn, uint8_t error)
{
	struct bt_conn_info info;

	last_connect_error = error;
	if (error != 0U || bt_conn_get_info(conn, &info) != 0 ||
	    bt_hci_get_conn_handle(conn, &current_handle) != 0) {
		k_sem_give(&attempt_ended);
		return;
	}
	current_conn = bt_conn_ref(conn);
	atomic_set(&is_connected, 1);
	callbacks->connected(current_handle, info.role == BT_CONN_ROLE_CENTRAL);
	k_sem_give(&attempt_ended);
}

/* The link thread may be waiting for something to send. When the queue is full it is not. */
static void wake_link_thread(void)
{
	static const struct value wake = {.len = 0};

	(void)k_msgq_put(&tx_queue, &wake, K_NO_WAIT);
}

static void on_disconnected(struct bt_conn *conn, uint8_t reason)
{
	ARG_UNUSED(reason);
	if (conn != current_conn) {
		return;
	}
	atomic_clear(&is_ready);
	atomic_clear(&is_connected);
	atomic_inc(&disconnects);
	callbacks->disconnected();
	wake_link_thread();
}

static bool on_param_request(struct bt_conn *conn, struct bt_le_conn_param *param)
{
	ARG_UNUSED(conn);
	ARG_UNUSED(param);
	/* The interval is the leader's choice; the sync and the streams are sized for it. */
	return false;
}

BT_CONN_CB_DEFINE(link_conn_callbacks) = {
	.connected = on_connected,
	.disconnected = on_disconnected,
	.le_param_req = on_param_request,
};

void link_receive(const void *value, uint16_t len)
{
	const uint8_t *bytes = value;

	/* What a stranger says is not even looked at. */
	if (len < 1U || !link_security_is_proved() ||
	    !callbacks->message(bytes[0], bytes + 1, len - 1U)) {
		atomic_inc(&bad_payloads);
	}
}

int link_send(uint8_t type, const uint8_t *payload, size_t len)
{
	struct value value;

	if (!atomic_get(&is_ready)) {
		return -ENOTCONN;
	}
	if (len > WIRE_MAX_PAYLOAD_SIZE) {
		return -EMSGSIZE;
	}
	value.len = (uint8_t)(1U + len);
	value.bytes[0] = type;
	memcpy(value.bytes + 1, payload, len);
	if (k_msgq_put(&tx_queue, &value, K_NO_WAIT) != 0) {
		atomic_inc(&tx_dropped);
		return -ENOSPC;
	}
	return 0;
}

void link_drop(uint16_t hold_off_ms)
{
	atomic_set(&hold_ms, hold_off_ms);
	atomic_set(&drop_wanted, 1);
	wake_link_thread();
}

static void drain_queue(struct bt_conn *conn)
{
	static struct value value;

	while (atomic_get(&is_connected)) {
		int err;

		(void)k_msgq_get(&tx_queue, &value, K_FOREVER);
		if (atomic_cas(&drop_wanted, 1, 0)) {
			(void)bt_conn_disconnect(conn, BT_HCI_ERR_REMOTE_USER_TERM_CONN);
		}
		if (value.len == 0U || !atomic_get(&is_connected)) {
			continue;
		}
		watchdog_begin(WATCHDOG_LINK);
		err = link_role_transmit(conn, value.bytes, value.len);
		watchdog_end(WATCHDOG_LINK);
		if (err) {
			atomic_inc(&tx_dropped);
		} else if (value.bytes[0] == WIRE_IMU_BATCH_ID) {
			atomic_inc(&batches_sent);
		}
	}
}

static void serve_connection(void)
{
	struct bt_conn *conn = current_conn;

	/* Nothing said on an earlier connection may be heard on this one. */
	k_msgq_purge(&tx_queue);
	atomic_clear(&drop_wanted);
	if (link_role_setup(conn) == 0) {
		if (atomic_get(&is_connected)) {
			atomic_set(&is_ready, 1);
			callbacks->ready();
		}
		drain_queue(conn);
	} else {
		(void)bt_conn_disconnect(conn, BT_HCI_ERR_REMOTE_USER_TERM_CONN);
		while (atomic_get(&is_connected)) {
			k_sleep(K_MSEC(10));
		}
	}
	current_conn = NULL;
	bt_conn_unref(conn);
}

static void link_thread(void *p1, void *p2, void *p3)
{
	ARG_UNUSED(p1);
	ARG_UNUSED(p2);
	ARG_UNUSED(p3);
	(void)k_sem_take(&bluetooth_ready, K_FOREVER);
	for (;;) {
		/* Taken once: K_MSEC() evaluates its argument twice. */
		const atomic_val_t hold = atomic_clear(&hold_ms);

		k_sleep(K_MSEC(hold));
		k_sem_reset(&attempt_ended);
		if (link_role_seek() != 0 || k_sem_take(&attempt_ended, CONNECT_TIMEOUT) != 0 ||
		    last_connect_error != 0U) {
			if (!atomic_get(&is_connected)) {
				k_sleep(RETRY_DELAY);
				continue;
			}
		}
		serve_connection();
	}
}

K_THREAD_DEFINE(bv_link, CONFIG_BV_LINK_STACK_SIZE, link_thread, NULL, NULL, NULL,
		K_PRIO_PREEMPT(3), 0, 0);

int link_start(const struct link_callbacks *application)
{
	int err;

	callbacks = application;
	err = bt_enable(NULL);
	if (!err) {
		err = link_security_enable();
	}
	if (!err) {
		k_sem_give(&bluetooth_ready);
	}
	return err;
}

static int8_t read_rssi(void)
{
	struct bt_hci_cp_read_rssi *command;
	const struct bt_hci_rp_read_rssi *answer;
	struct net_buf *response = NULL;
	struct net_buf *buf = bt_hci_cmd_create(BT_HCI_OP_READ_RSSI, sizeof(*command));
	int8_t rssi_dbm = RSSI_UNKNOWN;

	if (buf == NULL) {
		return RSSI_UNKNOWN;
	}
	command = net_buf_add(buf, sizeof(*command));
	command->handle = sys_cpu_to_le16(current_handle);
	if (bt_hci_cmd_send_sync(BT_HCI_OP_READ_RSSI, buf, &response) != 0) {
		return RSSI_UNKNOWN;
	}
	answer = (const void *)response->data;
	if (answer->status == 0U) {
		rssi_dbm = answer->rssi;
	}
	net_buf_unref(response);
	return rssi_dbm;
}

static void fill_connection(struct wire_link_stats *stats, struct bt_conn *conn)
{
	struct bt_conn_info info;

	if (bt_conn_get_info(conn, &info) != 0) {
		return;
	}
	stats->connected = 1;
	stats->phy = info.le.phy->tx_phy;
	stats->mtu = bt_gatt_get_mtu(conn);
	stats->conn_interval_us = info.le.interval * CONN_INTERVAL_UNIT_US;
	stats->rssi_dbm = read_rssi();
}

void link_stats_fill(struct wire_link_stats *stats)
{
	struct bt_conn *conn = NULL;

	stats->connected = 0;
	stats->phy = 0;
	stats->mtu = 0;
	stats->conn_interval_us = 0;
	stats->rssi_dbm = RSSI_UNKNOWN;
	stats->disconnects = (uint16_t)atomic_get(&disconnects);
	stats->batches_sent = (uint32_t)atomic_get(&batches_sent);
	stats->tx_dropped = (uint32_t)atomic_get(&tx_dropped);
	stats->bad_payloads = (uint32_t)atomic_get(&bad_payloads);
	k_sched_lock();
	if (atomic_get(&is_connected) && current_conn != NULL) {
		conn = bt_conn_ref(current_conn);
	}
	k_sched_unlock();
	if (conn != NULL) {
		fill_connection(stats, conn);
		bt_conn_unref(conn);
	}
}
