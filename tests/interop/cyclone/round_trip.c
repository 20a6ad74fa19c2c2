// One end of requests and replies over Cyclone DDS, to hold our own services against: the topics, qualities of service and
// waiting are those of rmw_cyclonedds.
//
// round_trip pong DOMAIN         answers every request with what it brought
// round_trip ping DOMAIN BYTES   for every number read from stdin makes so many calls, and prints what they took, ns

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "Sample.h"
#include "dds/dds.h"

static dds_entity_t check(dds_entity_t result, const char *what) {
  if (result < 0) {
    fprintf(stderr, "%s: %s\n", what, dds_strretcode(-result));
    exit(1);
  }
  return result;
}

static double now_ns(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return 1e9 * (double)now.tv_sec + (double)now.tv_nsec;
}

static dds_entity_t reader, writer, waiting;

// Waits for the next sample and takes it.
static void receive(Sample *sample) {
  void *samples[1] = {sample};
  dds_sample_info_t info;
  for (;;) {
    if (check(dds_take(reader, samples, &info, 1, 1), "take") == 1 && info.valid_data) {
      return;
    }
    check(dds_waitset_wait(waiting, NULL, 0, DDS_SECS(20)), "wait");
  }
}

static void send(Sample *sample) { check(dds_write(writer, sample), "write"); }

static void wait_until_matched(void) {
  dds_publication_matched_status_t there;
  dds_subscription_matched_status_t back;
  do {
    check(dds_get_publication_matched_status(writer, &there), "writer");
    check(dds_get_subscription_matched_status(reader, &back), "reader");
    dds_sleepfor(DDS_MSECS(1));
  } while (there.current_count == 0 || back.current_count == 0);
}

int main(int count, char **arguments) {
  const int answers = count == 3 && strcmp(arguments[1], "pong") == 0;
  if (!answers && !(count == 4 && strcmp(arguments[1], "ping") == 0)) {
    fprintf(stderr, "usage: round_trip pong DOMAIN | ping DOMAIN BYTES\n");
    return 2;
  }
  dds_entity_t participant =
      check(dds_create_participant((dds_domainid_t)atoi(arguments[2]), NULL, NULL), "participant");
  dds_entity_t request = check(dds_create_topic(participant, &Sample_desc, "rq/echoRequest", NULL, NULL), "topic");
  dds_entity_t reply = check(dds_create_topic(participant, &Sample_desc, "rr/echoReply", NULL, NULL), "topic");
  dds_qos_t *qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 10);
  reader = check(dds_create_reader(participant, answers ? request : reply, qos, NULL), "reader");
  writer = check(dds_create_writer(participant, answers ? reply : request, qos, NULL), "writer");
  waiting = check(dds_create_waitset(participant), "waitset");
  dds_entity_t something = check(dds_create_readcondition(reader, DDS_ANY_STATE), "condition");
  check(dds_waitset_attach(waiting, something, 0), "attach");

  Sample received = {0};
  if (answers) {
    for (;;) {
      receive(&received);
      send(&received);
    }
  }
  wait_until_matched();
  Sample sent = {0};
  sent.data._length = sent.data._maximum = (uint32_t)atoi(arguments[3]);
  sent.data._buffer = calloc(1, sent.data._length);
  for (long calls; scanf("%ld", &calls) == 1;) {
    const double since_ns = now_ns();
    for (long call = 0; call < calls; call++) {
      send(&sent);
      receive(&received);
    }
    printf("%.0f\n", now_ns() - since_ns);
    fflush(stdout);
  }
  return 0;
}
