//! Replies that take more than one datagram of an ordinary network.

use minifactory_msgs::srv::{ReportHandover, ReportHandoverRequest, ReportHandoverResponse};

use super::echo::EchoNode;
use crate::common::{Kind, Peer, hex};

/// Lengths in bytes about the least that is sent in fragments, of no multiple of four among them, and the largest that a
/// node of ours answers with many times over.
const LENGTHS: [usize; 8] = [900, 1_001, 1_164, 1_398, 2_000, 4_097, 30_003, 60_000];

/// RustDDS alone never gets such a reply to Fast DDS, nor any that follows on the same service.
#[test]
fn regress_long_replies_reach_every_client_and_block_none() {
    for kind in Kind::BOTH {
        let node = EchoNode::start();
        let mut peer = Peer::start(kind, node.domain.id);
        peer.client::<ReportHandover>("report", "/test/report");
        for (number, length) in (1..).zip(LENGTHS.into_iter().flat_map(|length| [length, 4])) {
            let text: String = ('a'..='z').cycle().take(length).collect();
            let request = ReportHandoverRequest { delivery_id: text.clone(), ..ReportHandoverRequest::default() };
            peer.call("report", number, &request);
            let reply = peer.reply("report", number);
            // A reader may leave what fills the last word.
            let expected = hex(&ReportHandoverResponse {
                accepted: request.report == ReportHandoverRequest::TAKEN,
                message: text,
            });
            let filling = reply.hex.strip_prefix(&expected);
            assert!(
                filling.is_some_and(|rest| rest.len() < 8),
                "{kind:?}: {length} bytes came back as {}",
                reply.hex.len() / 2
            );
        }
        assert!(!peer.has_stray_replies());
        node.stop();
    }
}
