"""Names of SBF blocks, as `inspect` reports them (Septentrio, SBF reference guides)."""

from __future__ import annotations

from typing import Final

_BLOCKS: Final = (
    "4000MeasExtra 4001DOP 4002GALNav 4003GALAlm 4004GLONav 4005GLOAlm 4006PVTCartesian 4007PVTGeodetic "
    "4012SatVisibility 4013ChannelStatus 4014ReceiverStatus 4015Commands 4017GPSRawCA 4018GPSRawL2C 4019GPSRawL5 "
    "4020GEORawL1 4021GEORawL5 4022GALRawFNAV 4023GALRawINAV 4024GALRawCNAV 4026GLORawCA 4027MeasEpoch "
    "4028BaseVectorGeod 4030GALIon 4031GALUtc 4032GALGstGps 4034GALSARRLM 4036GLOTime 4037ExtEventPVTCartesian "
    "4038ExtEventPVTGeodetic 4040BBSamples 4042GPSCNav 4043BaseVectorCart 4044PosCart 4047BDSRaw 4049RTCMDatum "
    "4052PosLocal 4053NTRIPClientStatus 4058IPStatus 4059DiskStatus 4066QZSRawL1CA 4067QZSRawL2C 4068QZSRawL5 "
    "4075ASCIIIn 4076PVTSupport 4079PVTSupportA 4081BDSNav 4082QualityInd 4090InputLink 4091OutputLink 4092RFStatus "
    "4093NAVICRaw 4094PosProjected 4095QZSNav 4097EncapsulatedOutput 4103RxMessage 4105DynDNSStatus 4109Meas3Ranges "
    "4110Meas3CN0HiRes 4111Meas3Doppler 4112Meas3PP 4113Meas3MP 4116QZSAlm 4119BDSAlm 4120BDSIon 4121BDSUtc "
    "4122NTRIPServerStatus 4201LBandTrackerStatus 4204LBandBeams 4211FugroDDS 4212LBandRaw 4214FugroStatus "
    "4217ExtEventBaseVectGeod 4218BDSRawB1C 4219BDSRawB2a 4221GPSRawL1C 4227QZSRawL1C 4228QZSRawL1S "
    "4237ExtEventAttEuler 4238P2PPStatus 4242BDSRawB2b 4245GALAuthStatus 4246QZSRawL5S 4251BDSCNav1 4252BDSCNav2 "
    "4253BDSCNav3 4254NavICLNav 4270QZSRawL6D 4271QZSRawL6E 4272NavCart 4275NavGeod 5891GPSNav 5892GPSAlm 5893GPSIon "
    "5894GPSUtc 5896GEONav 5897GEOAlm 5902ReceiverSetup 5905PosCovCartesian 5906PosCovGeodetic 5907VelCovCartesian "
    "5908VelCovGeodetic 5911xPPSOffset 5914ReceiverTime 5917GEOServiceLevel 5918GEONetworkTime 5919DiffCorrIn "
    "5921EndOfPVT 5922EndOfMeas 5924ExtEvent 5925GEOMT00 5926GEOPRNMask 5927GEOFastCorr 5928GEOIntegrity "
    "5929GEOFastCorrDegr 5930GEODegrFactors 5931GEOIGPMask 5932GEOLongTermCorr 5933GEOIonoDelay "
    "5934GEOClockEphCovMatrix 5936Comment 5938AttEuler 5939AttCovEuler 5942AuxAntPositions 5943EndOfAtt "
    "5949BaseStation"
)

NAMES: Final = {int(block[:4]): block[4:] for block in _BLOCKS.split()}
"""Name of each block by its number."""
