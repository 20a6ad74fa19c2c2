//! Who may come in: a page of this server itself, with the token where one is needed.

use std::collections::BTreeMap;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Mutex, PoisonError};

use axum::http::{HeaderMap, StatusCode, header};

/// What is asked of whoever comes.
#[derive(Clone, Debug)]
pub(crate) struct Guard {
    address: SocketAddr,
    /// Has to be given where the server can be reached from elsewhere.
    token: Option<String>,
}

/// Counts those who were turned away, by the reason, and says so: at the first, second, fourth, eighth time, so that
/// nobody can fill the log.
#[derive(Default)]
pub(crate) struct TurnedAway(Mutex<BTreeMap<&'static str, u64>>);

impl TurnedAway {
    /// Counts one; true when it was said.
    pub(crate) fn count(&self, why: &'static str, what: &str) -> bool {
        let mut counts = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let count = counts.entry(why).or_insert(0);
        *count += 1;
        let says = count.is_power_of_two();
        if says {
            tracing::warn!("view: {why}, {count} so far: {}", what.trim_end());
        }
        says
    }
}

/// Why somebody may not come in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// The name by which it was reached is none of the server's: a foreign name may lead here by DNS.
    ForeignHost,
    /// A page of somewhere else asks.
    ForeignOrigin,
    /// No token, or a wrong one.
    WrongToken,
    /// No more room.
    TooManyViewers,
}

impl Refusal {
    /// As HTTP says it, and for people.
    pub(crate) fn answer(self) -> (StatusCode, &'static str) {
        match self {
            Self::ForeignHost => (StatusCode::FORBIDDEN, "this server does not go by that name\n"),
            Self::ForeignOrigin => (StatusCode::FORBIDDEN, "a page of another origin may not look\n"),
            Self::WrongToken => (StatusCode::UNAUTHORIZED, "the address needs the token that was printed with it\n"),
            Self::TooManyViewers => (StatusCode::SERVICE_UNAVAILABLE, "there are as many viewers as may be\n"),
        }
    }
}

/// The host of `host:port`, without the brackets of an IPv6 address.
fn host_of(authority: &str) -> &str {
    if let Some((inside, _)) = authority.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
        return inside;
    }
    authority.rsplit_once(':').map_or(authority, |(host, _)| host)
}

impl Guard {
    /// Of a server bound to `address`.
    pub(crate) fn new(address: SocketAddr, token: Option<String>) -> Self {
        Self { address, token }
    }

    /// What the server is bound to.
    pub(crate) fn address(&self) -> SocketAddr {
        self.address
    }

    /// Where the page is.
    pub(crate) fn url(&self) -> String {
        // Nobody can go to "any address": this machine can go to its own.
        let mut address = self.address;
        if address.ip().is_unspecified() {
            let own =
                if address.is_ipv4() { IpAddr::from([127, 0, 0, 1]) } else { IpAddr::from([0, 0, 0, 0, 0, 0, 0, 1]) };
            address.set_ip(own);
        }
        let token = self.token.as_ref().map(|token| format!("?token={token}")).unwrap_or_default();
        format!("http://{address}/{token}")
    }

    /// Checks what a browser says of how it came here.
    ///
    /// # Errors
    /// A name that is not the server's, or a page of somewhere else.
    pub(crate) fn check_origin(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        let text = |name| headers.get(name).map(|value| value.to_str().unwrap_or_default());
        let host = text(header::HOST).ok_or(Refusal::ForeignHost)?;
        // Where a token is needed a foreign name is of no use without it.
        if self.token.is_none() && !self.is_own(host_of(host)) {
            return Err(Refusal::ForeignHost);
        }
        match text(header::ORIGIN) {
            Some(origin) if origin.strip_prefix("http://") != Some(host) => Err(Refusal::ForeignOrigin),
            _ => Ok(()),
        }
    }

    fn is_own(&self, host: &str) -> bool {
        host.eq_ignore_ascii_case("localhost")
            || host.parse().is_ok_and(|ip: IpAddr| ip == self.address.ip() || ip.is_loopback())
    }

    /// Checks the token, if one is needed.
    ///
    /// # Errors
    /// No token, or a wrong one.
    pub(crate) fn check_token(&self, given: Option<&str>) -> Result<(), Refusal> {
        let Some(token) = &self.token else { return Ok(()) };
        let given = given.unwrap_or_default();
        // As long for a token that is nearly right as for any other.
        let differing = token.bytes().zip(given.bytes()).fold(0, |all, (a, b)| all | (a ^ b));
        if differing == 0 && token.len() == given.len() { Ok(()) } else { Err(Refusal::WrongToken) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(host: &str, origin: Option<&str>) -> HeaderMap {
        let mut headers = HeaderMap::new();
        headers.insert(header::HOST, host.parse().unwrap());
        origin.into_iter().for_each(|origin| _ = headers.insert(header::ORIGIN, origin.parse().unwrap()));
        headers
    }

    #[test]
    fn a_loopback_server_takes_its_own_page_alone() {
        let guard = Guard::new("127.0.0.1:8080".parse().unwrap(), None);
        let check = |host: &str, origin: Option<&str>| guard.check_origin(&headers(host, origin));
        for host in ["127.0.0.1:8080", "localhost:8080", "LOCALHOST:8080", "[::1]:8080", "localhost"] {
            assert_eq!(check(host, None), Ok(()), "{host}");
            assert_eq!(check(host, Some(&format!("http://{host}"))), Ok(()), "{host}");
        }
        assert_eq!(check("feeder.example:8080", None), Err(Refusal::ForeignHost));
        assert_eq!(check("127.0.0.1.example:8080", None), Err(Refusal::ForeignHost));
        for origin in ["http://example.com", "https://127.0.0.1:8080", "http://127.0.0.1:8081", "null", ""] {
            assert_eq!(check("127.0.0.1:8080", Some(origin)), Err(Refusal::ForeignOrigin), "{origin}");
        }
        assert_eq!(guard.check_origin(&HeaderMap::new()), Err(Refusal::ForeignHost));
        assert_eq!(guard.check_token(None), Ok(()));
        assert_eq!(guard.url(), "http://127.0.0.1:8080/");
    }

    #[test]
    fn a_flood_does_not_fill_the_log() {
        let turned_away = TurnedAway::default();
        let said = (0..1000).filter(|_| turned_away.count("somebody was turned away", "why")).count();
        assert_eq!(said, 10);
        assert!(turned_away.count("a viewer was sent away", "another reason"));
    }

    #[test]
    fn elsewhere_the_token_decides() {
        let guard = Guard::new("0.0.0.0:9000".parse().unwrap(), Some("abc123".to_owned()));
        assert_eq!(guard.check_origin(&headers("cell.example:9000", Some("http://cell.example:9000"))), Ok(()));
        let foreign = headers("cell.example:9000", Some("http://example.com"));
        assert_eq!(guard.check_origin(&foreign), Err(Refusal::ForeignOrigin));
        assert_eq!(guard.check_token(Some("abc123")), Ok(()));
        for wrong in [None, Some(""), Some("abc12"), Some("abc1234"), Some("abc124")] {
            assert_eq!(guard.check_token(wrong), Err(Refusal::WrongToken), "{wrong:?}");
        }
        assert_eq!(guard.url(), "http://127.0.0.1:9000/?token=abc123");
    }
}
