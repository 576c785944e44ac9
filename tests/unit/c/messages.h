/* SPDX-License-Identifier: Apache-2.0 */
/* Every message by name; a test holds this list against the table. */
#ifndef MESSAGES_H_
#define MESSAGES_H_

#define FOR_EACH_MESSAGE(X)                                                                        \
	X(hello, HELLO)                                                                            \
	X(imu_batch, IMU_BATCH)                                                                    \
	X(sync_capture, SYNC_CAPTURE)                                                              \
	X(sync_pair, SYNC_PAIR)                                                                    \
	X(sync_state, SYNC_STATE)                                                                  \
	X(pulse, PULSE)                                                                            \
	X(fifo_stats, FIFO_STATS)                                                                  \
	X(link_stats, LINK_STATS)                                                                  \
	X(ekf_state, EKF_STATE)                                                                    \
	X(attitude, ATTITUDE)                                                                      \
	X(cal_status, CAL_STATUS)                                                                  \
	X(system, SYSTEM)                                                                          \
	X(fault, FAULT)                                                                            \
	X(imu_setup, IMU_SETUP)                                                                    \
	X(link_drop, LINK_DROP)                                                                    \
	X(cal_record, CAL_RECORD)                                                                  \
	X(node_command, NODE_COMMAND)                                                              \
	X(rep, REP)                                                                                \
	X(link_key, LINK_KEY)                                                                      \
	X(link_security, LINK_SECURITY)                                                            \
	X(thread, THREAD)

#endif /* MESSAGES_H_ */
