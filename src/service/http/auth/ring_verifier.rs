//! Checks signatures of tokens with ring, the cryptography provider of the whole program.

use jsonwebtoken::crypto::{CryptoProvider, JwtVerifier, KeyUtils};
use jsonwebtoken::errors::{Error, ErrorKind};
use jsonwebtoken::{Algorithm, DecodingKey, DecodingKeyKind};
use ring::signature::{self as ring_signature, RsaParameters, RsaPublicKeyComponents, UnparsedPublicKey};
use signature::Verifier;

/// Accepted signature algorithms, all with public keys.
///
/// Shared secrets are excluded: anyone who knows the public key could use it as a secret to sign.
pub(super) const ALGORITHMS: [Algorithm; 9] = [
    Algorithm::RS256,
    Algorithm::RS384,
    Algorithm::RS512,
    Algorithm::PS256,
    Algorithm::PS384,
    Algorithm::PS512,
    Algorithm::ES256,
    Algorithm::ES384,
    Algorithm::EdDSA,
];

/// Cryptography provider that only verifies.
///
/// The program signs no tokens, and it reads keys as the identity provider publishes them.
static PROVIDER: CryptoProvider = CryptoProvider {
    signer_factory: |_, _| Err(ErrorKind::InvalidAlgorithm.into()),
    verifier_factory: verifier,
    key_utils: KeyUtils::new_unimplemented(),
};

/// Makes `jsonwebtoken` use ring. A second call in the same process has no effect.
pub(super) fn install() {
    PROVIDER.install_default().ok();
}

fn verifier(algorithm: &Algorithm, key: &DecodingKey) -> Result<Box<dyn JwtVerifier>, Error> {
    // A shared secret is never used as a public key.
    if key.family() != algorithm.family() {
        return Err(ErrorKind::InvalidKeyFormat.into());
    }
    let method = Method::of(*algorithm).ok_or(ErrorKind::InvalidAlgorithm)?;
    Ok(Box::new(RingVerifier { algorithm: *algorithm, method, key: key.kind().clone() }))
}

/// Verification method of ring for an algorithm.
enum Method {
    Rsa(&'static RsaParameters),
    Curve(&'static dyn ring_signature::VerificationAlgorithm),
}

impl Method {
    fn of(algorithm: Algorithm) -> Option<Self> {
        Some(match algorithm {
            Algorithm::RS256 => Self::Rsa(&ring_signature::RSA_PKCS1_2048_8192_SHA256),
            Algorithm::RS384 => Self::Rsa(&ring_signature::RSA_PKCS1_2048_8192_SHA384),
            Algorithm::RS512 => Self::Rsa(&ring_signature::RSA_PKCS1_2048_8192_SHA512),
            Algorithm::PS256 => Self::Rsa(&ring_signature::RSA_PSS_2048_8192_SHA256),
            Algorithm::PS384 => Self::Rsa(&ring_signature::RSA_PSS_2048_8192_SHA384),
            Algorithm::PS512 => Self::Rsa(&ring_signature::RSA_PSS_2048_8192_SHA512),
            Algorithm::ES256 => Self::Curve(&ring_signature::ECDSA_P256_SHA256_FIXED),
            Algorithm::ES384 => Self::Curve(&ring_signature::ECDSA_P384_SHA384_FIXED),
            Algorithm::EdDSA => Self::Curve(&ring_signature::ED25519),
            Algorithm::HS256 | Algorithm::HS384 | Algorithm::HS512 | _ => return None,
        })
    }
}

struct RingVerifier {
    algorithm: Algorithm,
    method: Method,
    key: DecodingKeyKind,
}

impl Verifier<Vec<u8>> for RingVerifier {
    fn verify(&self, message: &[u8], signature: &Vec<u8>) -> Result<(), signature::Error> {
        let verified = match (&self.method, &self.key) {
            (Method::Rsa(parameters), DecodingKeyKind::RsaModulusExponent { n, e }) => {
                RsaPublicKeyComponents { n, e }.verify(parameters, message, signature)
            }
            (Method::Curve(curve), DecodingKeyKind::SecretOrDer(point)) => {
                UnparsedPublicKey::new(*curve, point).verify(message, signature)
            }
            (Method::Rsa(_), DecodingKeyKind::SecretOrDer(_))
            | (Method::Curve(_), DecodingKeyKind::RsaModulusExponent { .. }) => Err(ring::error::Unspecified),
        };
        verified.map_err(|_| signature::Error::new())
    }
}

impl JwtVerifier for RingVerifier {
    fn algorithm(&self) -> Algorithm {
        self.algorithm
    }
}

#[cfg(test)]
mod tests {
    use base64::Engine;
    use base64::engine::general_purpose::URL_SAFE_NO_PAD;
    use ring::signature::{EcdsaKeyPair, Ed25519KeyPair, KeyPair};

    use super::*;

    const MESSAGE: &[u8] = b"header.claims";
    /// An RSA key of 2048 bits and its signatures of [`MESSAGE`], made by OpenSSL (`openssl dgst -shaN -sign`, for PS with
    /// `-sigopt rsa_padding_mode:pss -sigopt rsa_pss_saltlen:-1`); ring makes no RSA keys.
    const MODULUS: &str = "rhwb-LhztB-1wG1Z87tupss4T5llIReW987I3L_GUnc5-VHF4GTPi7AS2lT4_k4AIkBmdIfiSsUmfZu4dYGTUfDOHNjIPv8GwrOtktavaIL2Spb8fCWM-0gZt-1xfD26uB_PP73ACoGgbv_jLPPB7eyTGNi-5T_G9thVNwh-B6A__oJMenhLOxfB07ecWMTG9EuSoLwcrcz1yjweNSE6EqOdoi7P58fKHlj-_6a_aLsQYEImAbeSy_1dTqBKpvswpAkhfR9L_sEHUZVZubcM8JUXloyxo_FtFzjyRbs1YbTQmjiY2RRxh3Ovo85rXuFQQuvsPzUD7avPY4j29KyQqw";
    const RSA_SIGNATURES: [(Algorithm, &str); 6] = [
        (
            Algorithm::RS256,
            "rPpCSXoZw9tuyioMBgzxHJKhQmroMO4ivKYNARdm7S3XWwXNcvBK8rSOvXUgPj9R61Z5_qMEdJsqVAikwG1ZEvRLkJ_Dv6IJ0S-5umYfKkXl8SSY7Sm6JwStZLw4Qli7Gcan9Rc6itqdfWyxLLLyqrCnAvKlr4iXNrSvU_1dvjuEpqbrwgKxpHM1NiPoQbVa6fyNIAKQeZ1d4gUUIFf0wlRErL5Q8k1Av95D5lWmhTpnr3qeDaGDRW0Khm9u9ogQ8qhT8lO-opyaJRko3gCT0jaeLlT3YYTXWjfIjQxny2EopHVsAOnoW9GwzdiiseSqH9y8f5burv1gWjyoZ1lNGg",
        ),
        (
            Algorithm::RS384,
            "Knq7TsGpCLHQ2RihrR5J-pNsvAHkVPbtt1OvHzUyjRFEBwsQLf4pM5gRI6CN_9gdujWKWfw5yhyJr5fdnY5uSbXzE4r1pjFG4-D17FSHoV0luKw4dtu7FJWbr2qa3TVQw74Gecy4g0YGsj8sjGOlkB1x4j8oHz4SRjU0sQk3tNTie9yCLfqU2rWgZVnTumgpBW9JcGMeJ4fnBa4dASSLuJySwfbCr4CIZV6Yvy_9x8Kxb6WKSfSvn05inGMyMiOddlLCv2uJRFdxjqNJZc9Xdnsa_I9eDn6BcYUfD8tjiGKm9CA_-Qldbqv-JHubfKt4rGG6TZM1fRiSuSfK2F7A4A",
        ),
        (
            Algorithm::RS512,
            "daagw3c_vMRiiKGf3L88EtFow7zqOohD2W1wOrDkBwhRBkrauQD7EG43dgM58fpfNvYLpwgU8jB5OyaE8_nWeawJqvKASDlpaJ-0G3rc3_urJov2yIh3W0BZGpSkRDmtbaRWWylJ_Zuz8y3zEbNVk_Nuyagx1qOFC1gGJm9gld8sCPqm5I382l0Ri2PmXxIu3RuTotQvb8MP1v7jzrzTG0-z7XD0naeIV-yIGyac2K097j3GV3QPIm1LFY0ZvBA-hbCzcRnB_XfqrEM51LLL9LR2u0sQpCNVyz2rDZPnLxYSS_RbHYa0yueOGHbCzghWJH1yUXA7GWzBFWKt21saTg",
        ),
        (
            Algorithm::PS256,
            "elqmu3CPlRD3fgno1p1UDb3gq6GMX6_h__Tr61QuBk2zeWj9ISDZ8NZOj_SnGRTphfvrSg5T-2DUWlX6VikIOXdgdS9Aq-JvbZBd1nSWHkfz5w6GwPPDbVgPWLYNfPFsw5Kgw984ijXvYTrLtKnNJdzc7DCG9Tnl6apMRKbSu-ZdNYRHIfV6dGgx9fqm3Q__AMEuHT6zWErKqTi9xN12tvpXGgeVMs_i8bTvno6mbnvsxoljZPwOys72vUliIfV5cBiDlfHNq4SVUaix2Zo3a3FwgT7WRcUKigWSqNEcpcV1n0Eh32rdYlxbAdZwYDENnYSvTn1DRLnTcwZ2z9UgeA",
        ),
        (
            Algorithm::PS384,
            "lKFmi-1uVmgZSEbJ8EUgX6Vi7r_9vrrsS8NvY1rUEBFZ49UmJLLmwtbOG0gtTPJpNoSq0o669NJJouLDuKRBIhsxJZSFGqBVUXII6Soo83Gv8f1qFo2v2OSiVgf_G-23QiNj1JgmyKUPgRNtpQDvrh6-JCmOCt5X5R4GRLHFFkpQ7a5s08ZLv-0VG59kGWV7EfhBRSloqMMRgOunUomCqWQ7JCToT4MGnAm2iV2n2x1JodrEu-lT751AfGgsVErEdDbwIhM8YHOo4CkiFZGIFZaqCN469lbZYgotxVMjcWcuzXem26ofGUCA-65KJCnllsJADg0hVEs0SZjig9B3Fg",
        ),
        (
            Algorithm::PS512,
            "YBdsBzwLNSMmBtNtErPtEs2HUYeQ4xECfWcQFu9U1tyFG1jFS8DdhW4iztDvxhjCeoGDtm3HnFwd30zpcifQdXYxh-PypfVVhOj6MtO8fJiZOCad_cvNXan3zPSYd1wrFdO6mVJYDoq8KEZUo9KL96elHkAgE0UGuKq5WElxGhsJvt571b2pWT9rzIOaZ_KRnonrOYbZC4tEVDsPqhdEwFF-X0xiam9iSFH9knQkoO7H3rWN0snk_7acp8QlBG_yoC5rMj6cuOrtlzYrrbkqn-BrOEj14qNQQu8jovMrv9Tdcr5z2cey3l-SQJne2kpNAAAYyKNfGKfWHV16XfjEuQ",
        ),
    ];

    /// Whether `key` accepts `signature` of `message`.
    fn accepts(algorithm: Algorithm, key: &DecodingKey, message: &[u8], signature: &[u8]) -> bool {
        verifier(&algorithm, key).is_ok_and(|v| v.verify(message, &signature.to_vec()).is_ok())
    }

    /// The signature is accepted; another message, algorithm or key and a truncated signature are not.
    fn check(algorithm: Algorithm, key: &DecodingKey, other_kind: &DecodingKey, signature: &[u8]) {
        assert!(accepts(algorithm, key, MESSAGE, signature), "{algorithm:?}");
        assert!(!accepts(algorithm, key, b"header.other", signature), "{algorithm:?}");
        assert!(!accepts(algorithm, key, MESSAGE, &signature[1..]), "{algorithm:?}");
        assert!(!accepts(algorithm, other_kind, MESSAGE, signature), "{algorithm:?}");
        if let DecodingKeyKind::SecretOrDer(bytes) = key.kind() {
            let secret = DecodingKey::from_secret(bytes);
            assert!(!accepts(algorithm, &secret, MESSAGE, signature), "{algorithm:?}: a public key sent as a secret");
        }
        for other in ALGORITHMS.into_iter().filter(|a| *a != algorithm) {
            assert!(!accepts(other, key, MESSAGE, signature), "{algorithm:?} as {other:?}");
        }
    }

    #[test]
    fn each_algorithm_takes_its_own_signatures_only() {
        let random = ring::rand::SystemRandom::new();
        let rsa = DecodingKey::from_rsa_components(MODULUS, "AQAB").unwrap();
        let pkcs8 = Ed25519KeyPair::generate_pkcs8(&random).unwrap();
        let pair = Ed25519KeyPair::from_pkcs8(pkcs8.as_ref()).unwrap();
        let ed = DecodingKey::from_ed_der(pair.public_key().as_ref());
        check(Algorithm::EdDSA, &ed, &rsa, pair.sign(MESSAGE).as_ref());
        for (algorithm, signing) in [
            (Algorithm::ES256, &ring_signature::ECDSA_P256_SHA256_FIXED_SIGNING),
            (Algorithm::ES384, &ring_signature::ECDSA_P384_SHA384_FIXED_SIGNING),
        ] {
            let pkcs8 = EcdsaKeyPair::generate_pkcs8(signing, &random).unwrap();
            let pair = EcdsaKeyPair::from_pkcs8(signing, pkcs8.as_ref(), &random).unwrap();
            let key = DecodingKey::from_ec_der(pair.public_key().as_ref());
            check(algorithm, &key, &rsa, pair.sign(&random, MESSAGE).unwrap().as_ref());
        }
        for (algorithm, signature) in RSA_SIGNATURES {
            check(algorithm, &rsa, &ed, &URL_SAFE_NO_PAD.decode(signature).unwrap());
        }
    }

    #[test]
    fn shared_secrets_check_nothing() {
        let key = DecodingKey::from_secret(b"secret");
        for algorithm in [Algorithm::HS256, Algorithm::HS384, Algorithm::HS512] {
            assert!(verifier(&algorithm, &key).is_err());
        }
    }
}
