/* Leads the arms of examples/gateway/external-arms.toml, flown with --operator udp:9870, from C.

       skywright gateway header > skywright_packets.h
       cc -std=c99 move_arms.c -lm -o move_arms                      without a key, on loopback
       cc -std=c99 -DWITH_KEY move_arms.c -lm -lcrypto -o move_arms  with one
       ./move_arms 127.0.0.1 9870 SECONDS [KEYFILE]

   It opens a session, asks for external joint references, sends a sine of the joints at 50 Hz for
   some seconds, and asks the robot to land. */
#define _POSIX_C_SOURCE 200809L
#include <arpa/inet.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>
#include "skywright_packets.h"

static int sock;
static skw_header header;
static skw_state state;
static uint8_t key[4096];
static size_t key_size;

#ifdef WITH_KEY
#include <openssl/evp.h>
#include <openssl/hmac.h>
static void hmac(const uint8_t *k, size_t k_n, const uint8_t *data, size_t n, uint8_t out[32]) {
    HMAC(EVP_sha256(), k, (int)k_n, data, n, out, NULL);
}
#endif

static void send_packet(uint8_t *packet, size_t n) {
#ifdef WITH_KEY
    skw_seal(packet, n, hmac, key, key_size);
#endif
    if (send(sock, packet, n, 0) < 0) perror("send");
}

static uint64_t now_us(void) { /* CLOCK_MONOTONIC never goes back when the time is set */
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u;
}

static void stamp(void) {
    header.time_us = now_us();
    header.sequence++;
}

/* Wait up to `ms` for a packet; returns its kind, 0 without one. */
static int receive(int ms, skw_acknowledgement *answer) {
    struct pollfd waiting = {.fd = sock, .events = POLLIN};
    uint8_t packet[SKW_MAX_SIZE];
    skw_header h;
    if (poll(&waiting, 1, ms) <= 0) return 0;
    ssize_t n = recv(sock, packet, sizeof packet, 0);
    if (n <= 0) return 0;
#ifdef WITH_KEY
    if (!skw_check(packet, (size_t)n, hmac, key, key_size)) return 0;
#endif
    if (skw_decode_acknowledgement(packet, (size_t)n, &h, answer)) return SKW_ACKNOWLEDGEMENT;
    if (skw_decode_state(packet, (size_t)n, &h, &state)) return SKW_STATE;
    return 0;
}

/* Ask for an operation at 5 Hz until it is acknowledged; returns the result, -1 without one. */
static int operate(uint16_t code) {
    static uint32_t number;
    skw_operation request = {.operation = ++number, .code = code};
    skw_acknowledgement answer;
    uint8_t packet[SKW_MAX_SIZE];
    for (int tries = 0; tries < 50; tries++) {
        stamp();
        send_packet(packet, skw_encode_operation(packet, &header, &request));
        for (int waits = 0; waits < 20; waits++) {
            if (receive(10, &answer) == SKW_ACKNOWLEDGEMENT && answer.operation == number) {
                if (code == SKW_CODE_CONNECT) header.session = answer.opened;
                return answer.result;
            }
        }
    }
    return -1;
}

int main(int argc, char **argv) {
    if (argc < 4) return fprintf(stderr, "move_arms HOST PORT SECONDS [KEYFILE]\n"), 2;
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons((uint16_t)atoi(argv[2]))};
    inet_pton(AF_INET, argv[1], &to.sin_addr);
    if (argc > 4) {
        FILE *file = fopen(argv[4], "rb");
        if (!file) return perror(argv[4]), 2;
        key_size = fread(key, 1, sizeof key, file);
        while (key_size && (key[key_size - 1] == '\n' || key[key_size - 1] == '\r')) key_size--;
        fclose(file);
    }
    sock = socket(AF_INET, SOCK_DGRAM, 0);
    if (connect(sock, (struct sockaddr *)&to, sizeof to) != 0) return perror("connect"), 1;
    if (operate(SKW_CODE_CONNECT) != SKW_RESULT_ACCEPTED) return fprintf(stderr, "no answer\n"), 1;
    printf("session %u\n", (unsigned)header.session);
    int result = -1; /* the robot may still be taking off: ask until it offers the task */
    for (int tries = 0; tries < 600 && result != SKW_RESULT_ACCEPTED; tries++) {
        skw_acknowledgement answer;
        result = operate(SKW_CODE_JOINTS);
        for (int i = 0; i < 20; i++) receive(10, &answer); /* the newest state */
    }
    if (result != SKW_RESULT_ACCEPTED) return fprintf(stderr, "joints: result %d\n", result), 1;
    float start[SKW_MAX_JOINTS];
    memcpy(start, state.q, sizeof start);
    int cycles = (int)(50.0 * atof(argv[3])), heard = 0;
    uint64_t next = now_us();
    for (int k = 0; k < cycles; k++) {
        skw_joints joints = {.n = state.n};
        skw_acknowledgement answer;
        uint8_t packet[SKW_MAX_SIZE];
        for (uint32_t j = 0; j < state.n && j < SKW_MAX_JOINTS; j++)
            joints.q_ref[j] = start[j] + (j % 4 == 0 ? 0.2f * (float)sin(0.02 * k) : 0.0f);
        stamp();
        send_packet(packet, skw_encode_joints(packet, &header, &joints));
        for (next += 20000; now_us() < next;)
            heard += receive(1, &answer) == SKW_STATE;
    }
    printf("states %d, phase %.24s\n", heard, state.phase);
    printf("land: result %d\n", operate(SKW_CODE_LAND));
    operate(SKW_CODE_DISCONNECT);
    close(sock);
    return 0;
}
