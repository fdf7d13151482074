<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Colour: height of the crop, from bare (brown) over short (pale) to tall (dark green). -->
<qgis version="3.34.0" styleCategories="Symbology">
 <pipe>
  <provider>
   <resampling enabled="false" zoomedInResamplingMethod="nearestNeighbour" zoomedOutResamplingMethod="nearestNeighbour" maxOversampling="2"/>
  </provider>
  <rasterrenderer type="singlebandpseudocolor" band="1" alphaBand="-1" opacity="1" classificationMin="0" classificationMax="1.2" nodataColor="">
   <rastershader>
    <colorrampshader colorRampType="INTERPOLATED" classificationMode="1" clip="0" minimumValue="0" maximumValue="1.2" labelPrecision="3">
     <item value="0" label="0 m" color="#8c510a" alpha="255"/>
     <item value="0.1" label="0.1 m" color="#dfc27d" alpha="255"/>
     <item value="0.3" label="0.3 m" color="#f7fcb9" alpha="255"/>
     <item value="0.45" label="0.45 m" color="#addd8e" alpha="255"/>
     <item value="0.6" label="0.6 m" color="#41ab5d" alpha="255"/>
     <item value="0.8" label="0.8 m" color="#006837" alpha="255"/>
     <item value="1.2" label="1.2 m and more" color="#00331b" alpha="255"/>
    </colorrampshader>
   </rastershader>
  </rasterrenderer>
  <brightnesscontrast brightness="0" contrast="0" gamma="1"/>
  <huesaturation colorizeOn="0" saturation="0" grayscaleMode="0" invertColors="0"/>
  <rasterresampler maxOversampling="2"/>
  <resamplingStage>resamplingFilter</resamplingStage>
 </pipe>
 <blendMode>0</blendMode>
</qgis>
